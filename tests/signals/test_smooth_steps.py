"""Smooth steps: where they begin, end and join."""

from itertools import pairwise

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import MinimumJerk, SmoothSteps
from mann_torch.signals.smooth_steps import SMOOTHSTEPS

TIMES, VALUES = [1.0, 4.0], [[0.0, 1.0], [2.0, -1.0], [0.5, 0.25]]


def at(*times: float) -> torch.Tensor:
    return torch.tensor(times, dtype=torch.float64)


def test_smoothsteps_are_those_that_leave_and_arrive_at_rest() -> None:
    """S' is a multiple of (u (1 - u))^(d - 1)/2: that and S(0) = 0, S(1) = 1 settle all of it."""
    u = torch.linspace(0.0, 1.0, 21, dtype=torch.float64)
    for degree, coefficients in SMOOTHSTEPS.items():
        power = (degree - 1) // 2
        slope = sum(k * c * u ** (k - 1) for k, c in enumerate(coefficients) if k)
        wanted = slope[10] * (4.0 * u * (1.0 - u)) ** power  # type: ignore[index]
        torch.testing.assert_close(slope, wanted, rtol=0, atol=1e-12)
        assert coefficients[0] == 0.0 and sum(coefficients) == 1.0


@pytest.mark.parametrize(("degree", "smooth"), [(5, 2), (7, 3)])
def test_it_is_continuous_up_to_the_stated_derivative(degree: int, smooth: int) -> None:
    steps = SmoothSteps(TIMES, VALUES, [1.5, 2.0], degree)
    for knot in (1.0, 2.5, 4.0, 6.0):
        before, after = steps(at(knot - 1e-9)), steps(at(knot + 1e-9))
        for k, (left, right) in enumerate(zip(before.upto(4), after.upto(4), strict=True)):
            if k <= smooth:
                torch.testing.assert_close(left, right, rtol=0, atol=1e-5)
            elif k == smooth + 1:
                assert float((left - right).abs().min()) > 1.0


def test_it_holds_the_values_between_and_passes_half_way() -> None:
    steps = SmoothSteps(TIMES, VALUES, 2.0)
    sample = steps(at(0.0, 1.0, 3.0, 3.5, 4.0, 6.0, 99.0))
    rows = torch.tensor(VALUES, dtype=torch.float64)[[0, 0, 1, 1, 1, 2, 2]]
    torch.testing.assert_close(sample.value, rows, rtol=0, atol=1e-15)
    for part in sample.upto(2)[1:]:
        assert not part.any()
    half = (rows[0] + torch.tensor(VALUES[1]).double()) / 2
    torch.testing.assert_close(steps(at(2.0)).value[0], half, rtol=0, atol=1e-15)


def test_a_quintic_step_is_the_minimum_jerk_motion() -> None:
    t = torch.linspace(0.0, 5.0, 51, dtype=torch.float64)
    step, motion = SmoothSteps([1.0], VALUES[:2], 2.0)(t), MinimumJerk([1.0, 3.0], VALUES[:2])(t)
    for mine, theirs in zip(step.upto(4), motion.upto(4), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-12)


def test_overlapping_steps_add_up_and_a_short_one_is_a_jump() -> None:
    t = torch.linspace(0.0, 9.0, 200, dtype=torch.float64)
    both = SmoothSteps([1.0, 2.0], [[0.0], [1.0], [3.0]], 4.0)(t).value
    parts = [SmoothSteps([k], [[0.0], [k]], 4.0)(t).value for k in (1.0, 2.0)]
    torch.testing.assert_close(both, parts[0] + parts[1], rtol=0, atol=1e-15)
    for before, after in pairwise(both.flatten().tolist()):
        assert after >= before


def test_bad_arguments_are_named() -> None:
    with pytest.raises(mt.ConfigError, match=r"SmoothSteps duration .* > 0"):
        SmoothSteps(TIMES, VALUES, [1.0, 0.0])
    with pytest.raises(mt.ShapeError, match="SmoothSteps duration has shape"):
        SmoothSteps(TIMES, VALUES, [1.0, 1.0, 1.0])
    with pytest.raises(mt.ConfigError, match="degree = 6: choose 5 or 7"):
        SmoothSteps(TIMES, VALUES, 1.0, 6)
    with pytest.raises(mt.ConfigError, match=r"SmoothSteps times .* must increase"):
        SmoothSteps([2.0, 2.0], VALUES, 1.0)
    with pytest.raises(mt.ShapeError, match="one value row more"):
        SmoothSteps(TIMES, VALUES[:2], 1.0)
