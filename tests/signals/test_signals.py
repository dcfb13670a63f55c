"""References and schedules."""

import itertools
import math

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import growing_square, multiplied


def test_reference_derivatives_are_derivatives() -> None:
    reference = mt.Sinusoid([1.0, 0.4], [0.5, 2.0], [0.0, 0.1])
    t = torch.tensor(1.3, dtype=torch.float64)
    one = torch.ones_like(t)
    position = lambda u: reference(u).value  # noqa: E731
    velocity = lambda u: reference(u).rate  # noqa: E731
    sample = reference(t)
    torch.testing.assert_close(torch.func.jvp(position, (t,), (one,))[1], sample.rate)
    torch.testing.assert_close(torch.func.jvp(velocity, (t,), (one,))[1], sample.acceleration)
    assert sample.value[1].item() == pytest.approx(0.1 + 0.4 * math.sin(2.6), abs=1e-15)


def test_schedule_takes_the_new_value_at_its_jump_time() -> None:
    schedule = mt.PiecewiseConstant([1.0, 2.0], [[1.0], [10.0], [100.0]])
    t = torch.tensor([0.0, 0.999, 1.0, 1.5, 2.0, 9.0], dtype=torch.float64)
    assert schedule.at(t)[:, 0].tolist() == [1.0, 1.0, 10.0, 10.0, 100.0, 100.0]


def test_stacked_schedules_keep_their_own_times() -> None:
    a = mt.PiecewiseConstant([1.0], [[1.0], [2.0]])
    b = mt.PiecewiseConstant([0.5, 3.0], [[5.0], [6.0], [7.0]])
    both = mt.PiecewiseConstant.stack([a, b])
    assert both.knots() == [0.5, 1.0, 3.0]
    assert both.at(torch.tensor(2.0).double())[:, 0].tolist() == [2.0, 6.0]
    assert both.at(torch.tensor(4.0).double())[:, 0].tolist() == [2.0, 7.0]


def test_mass_rules_of_the_paper() -> None:
    rows = multiplied([[0.8, 2.3], [0.5, 1.0]], [2.0, 0.5])
    assert rows[0].tolist() == [[0.8, 2.3], [1.6, 4.6], [0.8, 2.3]]
    assert torch.equal(rows[1], multiplied([0.5, 1.0], [2.0, 0.5]))
    rows = growing_square([0.8, 2.3], 0.2, 5).tolist()
    for before, after in itertools.pairwise(rows):
        for j, start in enumerate((0.8, 2.3)):
            assert after[j] ** 2 == pytest.approx(before[j] ** 2 + 0.2 * start**2, rel=1e-14)


def test_bad_schedules_and_references_are_named() -> None:
    with pytest.raises(mt.ConfigError, match="increase"):
        mt.PiecewiseConstant([2.0, 1.0], [[1.0], [2.0], [3.0]])
    with pytest.raises(mt.ShapeError, match="one value row more"):
        mt.PiecewiseConstant([1.0], [[1.0]])
    with pytest.raises(mt.ConfigError, match="amplitude"):
        mt.Sinusoid([float("nan"), 0.0])
    with pytest.raises(mt.ShapeError, match="broadcast"):
        mt.Sinusoid([1.0, 2.0], [1.0, 2.0, 3.0])
