"""Benchmark problems with known answers, their controllers written as a user would."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.constraints import NonNegative
from mann_torch.plants import LinearPlant
from mann_torch.plants.rohrs import RohrsPlant
from mann_torch.signals import Sinusoid, SquareWave


class Gains(NamedTuple):
    reference: Tensor  # (..., 1)
    state: Tensor  # (..., 1)


class Mrac(mt.Controller):
    """u = k_r r + k_y y; k_r' = rate r e, k_y' = rate y e; e = y_m - y."""

    def __init__(self, rate: Any = 1.0, start: tuple[float, float] = (0.0, 0.0)) -> None:
        super().__init__()
        self.start = start
        self.declare("rate", rate, NonNegative())

    def initial_state(
        self, reference: Any, measurement: Any, batch_shape: Any, generator: Any = None,
        weights: Any = None,
    ) -> Any:  # fmt: skip
        rows = torch.ones(*batch_shape, 1, dtype=torch.float64)
        return Gains(self.start[0] * rows, self.start[1] * rows), None

    def forward(self, reference: Any, measurement: Any, state: Any, mode: Any) -> mt.ControlOutput:
        y, r = measurement[0], reference.command
        e, rate = reference.value - y, self.rate.unsqueeze(-1)
        u = state.reference * r + state.state * y
        return mt.ControlOutput(u, Gains(rate * r * e, rate * y * e), None)


def scalar_loop() -> tuple[mt.ClosedLoop, mt.Scenario]:
    plant = LinearPlant([[-1.0]], [[0.5]], [[1.0]])
    loop = mt.ClosedLoop(plant, Mrac([0.2, 1.0]), model=mt.LinearModel.first_order(2.0))
    return loop, mt.Scenario(SquareWave([1.0], 20.0), plant.parameters_of(), 100.0)


def test_scalar_mrac_has_the_known_gains() -> None:
    """Problem 6, both rates in one batch; V = e^2/2 + |k~|^2 / (4 rate) falls by 2 e^2 a second."""
    with torch.no_grad():
        run = mt.rollout(*scalar_loop(), mt.RungeKutta(5e-3), sample_dt=20.0)
    gains = run.states.controller
    known = {1: [[1.55884883, 0.45940876], [2.09404964, -0.07769416]]}
    known[-1] = [[2.22384735, -0.16941892], [3.19081058, -1.19125163]]
    for k, rows in known.items():
        found = torch.cat([gains.reference[k], gains.state[k]], dim=-1)
        torch.testing.assert_close(found, torch.tensor(rows).double(), rtol=1e-6, atol=0)
    rates = torch.tensor([0.2, 1.0], dtype=torch.float64)

    def energy(k: int) -> Tensor:
        off = (gains.reference[k] - 4.0).square() + (gains.state[k] + 2.0).square()
        error = run.states.model[k] - run.states.plant.x[k]
        return (error.square() / 2)[..., 0] + off[..., 0] / (4.0 * rates)

    # Composite Simpson between jumps, 20 s of which hold 2 half periods of even numbers of steps.
    e2 = run.error[..., 0].square()
    assert torch.equal(run.t, run.step_t)
    pairs = run.t.diff().reshape(-1, 2)
    torch.testing.assert_close(pairs[:, 0], pairs[:, 1], rtol=1e-9, atol=0)
    simpson = pairs.sum(-1, keepdim=True) / 6 * (e2[:-1:2] + 4 * e2[1::2] + e2[2::2])
    spent = 2.0 * simpson.sum(0)
    torch.testing.assert_close(energy(0) - energy(-1), spent, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_the_torch_engine_finds_the_same() -> None:
    loop, scenario = scalar_loop()
    short = mt.Scenario(scenario.reference, scenario.parameters, 20.0)
    with torch.no_grad():
        runs = [
            mt.rollout(loop, short, mt.RungeKutta(5e-3), engine=e) for e in ("torch", "compiled")
        ]
    torch.testing.assert_close(runs[0].plant.x, runs[1].plant.x, rtol=0, atol=1e-12)


def rohrs(amplitude: float, frequency: float, horizon: float) -> mt.Trajectory:
    plant = RohrsPlant()
    loop = mt.ClosedLoop(plant, Mrac(1.0, (1.14, -0.65)), model=mt.LinearModel.first_order(3.0))
    scenario = mt.Scenario(
        Sinusoid([amplitude], frequency, offset=0.3), plant.parameters_of(), horizon
    )
    with torch.no_grad():
        return mt.rollout(loop, scenario, mt.RungeKutta(1e-3), sample_dt=10.0)


def test_rohrs_counterexample_diverges_when_it_should() -> None:
    """Problem 2, the unmodelled phase crossing excited."""
    run = rohrs(1.85, 16.1, 21.2)
    k_y = run.states.controller.state[:, 0]
    torch.testing.assert_close(
        k_y[1:3], torch.tensor([-1.69945, -12.6394]).double(), rtol=1e-5, atol=0
    )
    first = int((run.output[:, 0].abs() >= 50.0).nonzero()[0])
    assert abs(float(run.t[first]) - 21.090) <= 1.5e-3


def test_rohrs_counterexample_stays_bounded_below_it() -> None:
    run = rohrs(2.0, 8.0, 80.0)
    k_y = run.states.controller.state[[1, 2, 8], 0]
    known = torch.tensor([-8.4445, -8.0922, -5.4877], dtype=torch.float64)
    torch.testing.assert_close(k_y, known, rtol=0, atol=6e-5)
    # benchmarks.md has 3.0240, of a grid that misses the peak: SciPy's dense output, at rtol 1e-10
    # and 1e-4 s, has 3.024295.
    assert abs(float(run.output.abs().max()) - 3.024295) <= 1e-5
