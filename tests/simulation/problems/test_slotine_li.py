"""Problem 3: Slotine and Li's arm with four unknown parameters."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConstantGain, Law, Projection, SlotineLi
from mann_torch.plants import SlotineLiArm
from mann_torch.signals import Sinusoids

RATES = torch.tensor([0.03, 0.05, 0.1, 0.3], dtype=torch.float64)
ADAPTING = AdaptiveLaw(ConstantGain(RATES))
PLANT = SlotineLiArm()


def loop_of(law: Law, start: object = 0.0) -> mt.ClosedLoop:
    return mt.ClosedLoop(PLANT, SlotineLi(PLANT, law, 20.0, 100.0, start))


def scenario(horizon: float = 3.0) -> mt.Scenario:
    rows = [[math.radians(30.0), math.radians(45.0)]]
    signal = Sinusoids(rows, 2 * math.pi, [[-math.pi / 2] * 2], offset=rows[0])
    return mt.Scenario(signal, PLANT.parameters_of(), horizon)


def rolled(law: Law, dt: float = 1e-4, start: object = 0.0, engine: str = "auto") -> mt.Trajectory:
    with torch.no_grad():
        return mt.rollout(
            loop_of(law, start), scenario(), mt.RungeKutta(dt), sample_dt=0.01, engine=engine
        )


def filtered(run: mt.Trajectory, q: Tensor, qd: Tensor, t: Tensor) -> Tensor:
    wanted = run.signal(t)
    return wanted.rate - qd + 20.0 * (wanted.value - q)


def energy(run: mt.Trajectory) -> Tensor:
    """V = r' M r / 2 + sum of a~^2 / (2 gamma) at every kept state."""
    state, known = run.states, PLANT.coefficients(PLANT.parameters_of())
    r = filtered(run, state.plant.q, state.plant.qd, run.sample_t).unsqueeze(-1)
    kinetic = 0.5 * (r.mT @ PLANT.mass_matrix(state.plant.q, known) @ r)[..., 0, 0]
    off = state.controller.estimate[..., 0] - known.a
    return kinetic + 0.5 * (off.square() / RATES).sum(-1)


def check_estimates(run: mt.Trajectory) -> None:
    # benchmarks.md has 1.320072 for the last: SciPy's DOP853, at rtol 1e-12, has 1.32007652.
    known = torch.tensor([0.173494, 0.660628, 1.759230, 1.3200765], dtype=torch.float64)
    found = run.states.controller.estimate[-1, :, 0]
    torch.testing.assert_close(found, known, rtol=0, atol=5e-7)


def check_peak(run: mt.Trajectory, known: list[float]) -> None:
    peak = torch.rad2deg(run.error.abs().amax(0))
    torch.testing.assert_close(peak, torch.tensor(known).double(), rtol=0, atol=5e-6)


def test_errors_and_estimates_are_the_known_ones() -> None:
    run = rolled(ADAPTING)
    check_estimates(run)
    check_peak(run, [3.24593, 1.28838])
    # The ledger, V(0) - V(3) = integral of r' K_D r: composite Simpson over pairs of equal steps.
    V = energy(run)
    assert abs(float(V[0]) - 201.335667) <= 5e-7
    power = 100.0 * filtered(run, run.plant.q, run.plant.qd, run.t).square().sum(-1)
    pairs = run.t.diff().reshape(-1, 2)
    torch.testing.assert_close(pairs[:, 0], pairs[:, 1], rtol=1e-9, atol=0)
    spent = (pairs.sum(-1) / 6 * (power[:-1:2] + 4 * power[1::2] + power[2::2])).sum()
    assert abs(float(V[0] - V[-1] - spent)) <= 1e-8
    assert bool((V.diff() <= 0).all())


def test_without_adaptation_errors_are_larger() -> None:
    check_peak(rolled(AdaptiveLaw(ConstantGain(0.0))), [5.63447, 2.25034])


def test_energy_never_grows_under_projection() -> None:
    """From estimates at their bound, which the gradient law alone would leave."""
    bound = 3.9  # |a| = 3.68: what is sought lies within.
    far = [bound * 0.97, 0.0, 0.0, 0.0]
    run = rolled(AdaptiveLaw(ConstantGain(RATES), Projection(bound, 0.1)), start=far)
    free = rolled(ADAPTING, start=far)
    size = run.states.controller.estimate[..., 0].norm(dim=-1)
    loose = free.states.controller.estimate[..., 0].norm(dim=-1)
    assert float(size.max()) <= bound < float(loose.max())
    assert bool((energy(run).diff() <= 0).all())


@pytest.mark.slow
def test_the_torch_engine_finds_the_same() -> None:
    runs = [rolled(ADAPTING, 1e-3, engine=engine) for engine in ("torch", "compiled")]
    check_estimates(runs[0])
    torch.testing.assert_close(runs[0].plant.q, runs[1].plant.q, rtol=0, atol=1e-12)
