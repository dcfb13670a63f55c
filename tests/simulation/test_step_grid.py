"""Steps end exactly on jumps."""

import math

import pytest
import torch

from mann_torch.errors import ConfigError
from mann_torch.simulation.step_grid import StepGrid


def test_every_knot_is_a_grid_time_and_no_step_is_longer_than_dt() -> None:
    grid = StepGrid(10.0, [1.0, math.pi, 9.9999], 0.005)
    times = grid.times.tolist()
    assert {0.0, 1.0, math.pi, 9.9999, 10.0} <= set(times)
    steps = grid.times.diff()
    assert bool((steps > 0).all()) and float(steps.max()) <= 0.005 * (1 + 1e-9)
    assert [s.first for s in grid.segments[1:]] == [s.last for s in grid.segments[:-1]]


def test_grid_of_a_330_s_run_is_uniform_and_does_not_drift() -> None:
    grid = StepGrid(330.0, [5.0, 25.0, 310.0], 0.005)
    assert grid.n_steps == 66000
    exact = torch.arange(66001, dtype=torch.float64) / 200
    assert float((grid.times - exact).abs().max()) <= 1e-12


@pytest.mark.parametrize("shift", [0.0, 1.0, -1.0])
def test_knots_one_ulp_apart_and_at_the_ends_leave_no_sliver(shift: float) -> None:
    near = math.nextafter(5.0, 5.0 + shift)
    grid = StepGrid(10.0, [math.ulp(1.0), 5.0, near, 10.0], 0.01)
    assert grid.n_steps == 1000
    assert [s.lookup for s in grid.segments] == [math.ulp(1.0), max(5.0, near)]


def test_samples_are_the_first_times_not_before_each_multiple() -> None:
    grid = StepGrid(1.0, [], 0.03)
    times = grid.times[grid.samples(0.1)]
    for k in range(10):
        assert any(0.1 * k - 1e-9 <= t < 0.1 * k + 0.0301 for t in times.tolist())
    assert times[-1] == 1.0
    with pytest.raises(ConfigError, match="sample_dt"):
        grid.samples(0.0)
