"""Schedules: values that jump, and the rows a schedule is made of."""

import itertools

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import PiecewiseConstant, growing_square


def test_schedule_takes_the_new_value_at_its_jump_time() -> None:
    schedule = PiecewiseConstant([1.0, 2.0], [[1.0], [10.0], [100.0]])
    t = torch.tensor([0.0, 0.999, 1.0, 1.5, 2.0, 9.0], dtype=torch.float64)
    assert schedule.at(t)[:, 0].tolist() == [1.0, 1.0, 10.0, 10.0, 100.0, 100.0]


def test_stacked_schedules_keep_their_own_times() -> None:
    a = PiecewiseConstant([1.0], [[1.0], [2.0]])
    b = PiecewiseConstant([0.5, 3.0], [[5.0], [6.0], [7.0]])
    both = PiecewiseConstant.stack([a, b])
    assert both.knots() == [0.5, 1.0, 3.0]
    assert both.at(torch.tensor(2.0).double())[:, 0].tolist() == [2.0, 6.0]
    assert both.at(torch.tensor(4.0).double())[:, 0].tolist() == [2.0, 7.0]
    assert both.select([1]).knots() == [0.5, 3.0]
    wide = both.expand((3, 2))
    assert wide.batch_shape == (3, 2)
    t = torch.linspace(0.0, 4.0, 5, dtype=torch.float64)
    assert torch.equal(wide.at(t), both.at(t).unsqueeze(1).expand(5, 3, 2, 1))


def test_values_in_force_receive_the_gradient() -> None:
    values = torch.tensor([[1.0], [2.0], [3.0]], dtype=torch.float64, requires_grad=True)
    schedule = PiecewiseConstant([1.0, 2.0], values).expand((2,)).select([1])
    schedule.at(torch.tensor(1.5).double()).sum().backward()
    assert values.grad is not None and values.grad[:, 0].tolist() == [0.0, 1.0, 0.0]


def test_mass_rules_of_the_paper() -> None:
    rows = growing_square([0.8, 2.3], 0.2, 5).tolist()
    for before, after in itertools.pairwise(rows):
        for j, start in enumerate((0.8, 2.3)):
            assert after[j] ** 2 == pytest.approx(before[j] ** 2 + 0.2 * start**2, rel=1e-14)


def test_bad_schedules_are_named() -> None:
    with pytest.raises(mt.ConfigError, match=r"schedule times .* must increase from > 0"):
        PiecewiseConstant([2.0, 1.0], [[1.0], [2.0], [3.0]])
    with pytest.raises(mt.ConfigError, match="must increase from > 0"):
        PiecewiseConstant([0.0], [[1.0], [2.0]])
    with pytest.raises(mt.ShapeError, match="one value row more"):
        PiecewiseConstant([1.0], [[1.0]])
    with pytest.raises(mt.ShapeError, match="schedule times has shape"):
        PiecewiseConstant(1.0, [1.0])
    with pytest.raises(mt.DtypeError, match="schedule values"):
        PiecewiseConstant([1.0], torch.ones(2, 1))
    with pytest.raises(mt.ConfigError, match="at least one, of one batch shape and one width"):
        PiecewiseConstant.stack([])


def test_a_schedule_that_was_changed_is_checked_again() -> None:
    schedule = PiecewiseConstant([1.0, 2.0], [[1.0], [2.0], [3.0]])
    schedule.times[0].fill_(3.0)
    with pytest.raises(mt.ConfigError, match=r"schedule of 'masses': times .* must increase"):
        schedule.check("schedule of 'masses':")
    schedule.times = schedule.times.float()
    with pytest.raises(mt.DtypeError, match=r"'masses': times is .*32"):
        schedule.check("schedule of 'masses':")
    with pytest.raises(mt.KindError, match=r"schedule times = .* must be a tensor"):
        schedule.times = [1.0, 2.0]  # type: ignore[assignment]
