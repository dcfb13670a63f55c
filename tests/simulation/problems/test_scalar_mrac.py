"""Problem 6 (Astrom and Wittenmark, example 5.7): one state, one input, two gains."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control
from mann_torch.plants import LinearPlant
from mann_torch.signals import SquareWave

RATES = [0.2, 1.0]


def scalar_loop(
    *parts: control.LawPart, start: tuple[float, float] = (0.0, 0.0), horizon: float = 100.0
) -> tuple[mt.ClosedLoop, mt.Scenario]:
    """x' = -x + u/2 after x_m' = -2 x_m + 2 r, u = k_x x + k_r r."""
    plant = LinearPlant([[-1.0]], [[0.5]], [[1.0]])
    law = control.AdaptiveLaw(control.ConstantGain(), *parts)
    rows = [[start[0]], [start[1]]]
    network = control.LinearNetwork(control.Identity(2), 1, law, start=rows)
    controller = control.Mrac([[1.0]], network)
    controller.initialize(adaptation_rate=RATES)
    loop = mt.ClosedLoop(plant, controller, model=mt.LinearModel.first_order(2.0))
    return loop, mt.Scenario(SquareWave([1.0], 20.0), plant.parameters_of(), horizon)


def gains(state: mt.LoopState) -> Tensor:
    """k_x and k_r (..., 2)."""
    found: Tensor = state.controller.adaptive.network.W[..., 0]
    return found


def energy(state: mt.LoopState) -> Tensor:
    """V = e^2/2 + |k~|^2 / (4 gamma) (...,)."""
    off = (gains(state) - torch.tensor([-2.0, 4.0], dtype=torch.float64)).square().sum(-1)
    error = (state.model - state.plant.x)[..., 0]
    return error.square() / 2 + off / (4.0 * torch.tensor(RATES, dtype=torch.float64))


def test_the_gains_are_the_known_ones_and_the_ledger_closes() -> None:
    """Both rates in one batch; V falls by 2 e^2 a second."""
    with torch.no_grad():
        run = mt.rollout(*scalar_loop(), mt.RungeKutta(5e-3), sample_dt=20.0)
    k = gains(run.states)
    known = {1: [[0.45940876, 1.55884883], [-0.07769416, 2.09404964]]}
    known[-1] = [[-0.16941892, 2.22384735], [-1.19125163, 3.19081058]]
    for at, rows in known.items():
        torch.testing.assert_close(
            k[at], torch.tensor(rows, dtype=torch.float64), rtol=0, atol=6e-9
        )

    # Composite Simpson between jumps, 20 s of which hold 2 half periods of even numbers of steps.
    e2 = run.error[..., 0].square()
    assert torch.equal(run.t, run.step_t)
    pairs = run.t.diff().reshape(-1, 2)
    torch.testing.assert_close(pairs[:, 0], pairs[:, 1], rtol=1e-9, atol=0)
    simpson = pairs.sum(-1, keepdim=True) / 6 * (e2[:-1:2] + 4 * e2[1::2] + e2[2::2])
    spent, V = 2.0 * simpson.sum(0), energy(run.states)
    torch.testing.assert_close(V[0] - V[-1], spent, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_the_torch_engine_finds_the_same() -> None:
    loop, scenario = scalar_loop(horizon=20.0)
    with torch.no_grad():
        found = mt.rollout(loop, scenario, mt.RungeKutta(5e-3), sample_dt=20.0, engine="torch")
    known = [[0.45940876, 1.55884883], [-0.07769416, 2.09404964]]
    torch.testing.assert_close(
        gains(found.states)[-1], torch.tensor(known, dtype=torch.float64), rtol=0, atol=6e-9
    )


def test_the_energy_never_grows_where_projection_acts() -> None:
    """Into a ball that holds the ideal gains, from its rim."""
    projected, free = control.Projection(4.7, 0.1), control.Projection(1e3, 0.1)
    runs = []
    for guard in (projected, free):
        loop, scenario = scalar_loop(guard, start=(-4.0, 2.2), horizon=40.0)
        with torch.no_grad():
            runs.append(mt.rollout(loop, scenario, mt.RungeKutta(5e-3), sample_dt=0.01))
    sizes = [gains(run.states).norm(dim=-1).amax() for run in runs]
    assert sizes[0] < 4.7 < sizes[1]
    growth = energy(runs[0].states).diff(dim=0)
    assert float(growth.max()) <= 1e-12
