"""A sampled loop against its exact discretisation."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import Sinusoid
from mann_torch.simulation.step_grid import StepGrid, Train
from tests.parts.linear import loop, scenario


def exact(period: float, count: int, hold: str) -> torch.Tensor:
    """States at ticks of x'' = u, u held or on a line, by the powers of h that end with the 3rd."""
    h, x, v, before = period, 0.2, 0.0, None
    found = [[x, v]]
    for k in range(count):
        u = 4.0 * float(torch.sin(torch.tensor(2.0 * k * h, dtype=torch.float64)))
        u = u - 4.0 * x - 3.0 * v
        slope = 0.0 if hold == "zero" or before is None else (u - before) / h
        x, v = x + h * v + h**2 * (u / 2 + h * slope / 6), v + h * (u + h * slope / 2)
        found.append([x, v])
        before = u
    return torch.tensor(found, dtype=torch.float64)


@pytest.mark.parametrize("engine", ["torch", "compiled"])
@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("period", [1e-3, 0.0137, 0.05])
def test_a_sampled_linear_loop_is_its_exact_discretisation(
    period: float, hold: str, engine: str
) -> None:
    count = int(0.3 / period)
    start = loop().plant.rest()._replace(x=torch.tensor([0.2, 0.0], dtype=torch.float64))
    given = scenario(count * period, start=start, reference=Sinusoid([1.0], 2.0))
    made = loop(clock=mt.Clock(period, hold=hold))
    with torch.no_grad():
        run = mt.rollout(made, given, mt.RungeKutta(0.004), engine=engine, sample_dt=period)
    torch.testing.assert_close(run.states.plant.x, exact(period, count, hold), rtol=0, atol=1e-12)


@pytest.mark.parametrize("dt", [0.004, 0.1, 0.00077])
@pytest.mark.parametrize("offset", [0.0, 0.003])
def test_a_step_ends_on_every_tick(dt: float, offset: float) -> None:
    grid = StepGrid(2.0, [0.31], dt, [Train(0.007), Train(0.01, offset)])
    for number, (period, first) in enumerate(((0.007, 0.0), (0.01, offset))):
        ticks = grid.times[:-1][grid.ticks(number)]
        wanted = first + period * torch.arange(len(ticks), dtype=torch.float64)
        assert len(ticks) == len(Train(period, first).until(2.0 - 1e-9))
        torch.testing.assert_close(ticks, wanted, rtol=0, atol=1e-9)
    assert (
        float(grid.times.diff().max()) <= dt * (1 + 1e-5) and float(grid.times.diff().min()) > 1e-9
    )


def test_jumps_that_rounding_tells_apart_are_one() -> None:
    grid = StepGrid(0.5, [], 0.004, (), [0.1 * 3, 0.3])
    assert float(grid.times.diff().min()) > 1e-3


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_nothing_is_commanded_before_the_first_tick(engine: str) -> None:
    start = loop().plant.rest()._replace(x=torch.tensor([0.2, 0.0], dtype=torch.float64))
    with torch.no_grad():
        run = mt.rollout(
            loop(clock=mt.Clock(0.05, 0.03)), scenario(0.1, start=start), mt.RungeKutta(0.004),
            engine=engine,
        )  # fmt: skip
    rests = run.t <= 0.03 + 1e-9
    assert torch.equal(run.plant.x[rests], start.x.expand(int(rests.sum()), 2))
    assert float(run.plant.x[-1, 1].abs()) > 0.01
