"""Problem 5: estimators on phi = (sin t, cos t), whose errors from (1, 2) have closed forms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import (
    AdaptiveLaw,
    ConcurrentLearning,
    ConstantGain,
    DeadZone,
    Drem,
    Drive,
    Estimator,
    Law,
    LeastSquares,
    SigmaModification,
)
from mann_torch.control.laws.drem import adjugate_and_determinant
from mann_torch.plants import LinearPlant, Regression
from mann_torch.signals import Disturbance, Polynomial

SOUGHT, FIRST = (0.5, -1.0), torch.tensor([1.0, 2.0], dtype=torch.float64)
NOTHING = Polynomial([[0.0]])
ENGINES = ["compiled", pytest.param("torch", marks=pytest.mark.slow)]


def rows(*numbers: Any) -> Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


def estimated(
    law: Law, horizon: float, engine: str, every: float, step: float = 5e-3
) -> tuple[mt.Trajectory, Tensor]:
    """The rollout, and theta~ (K, ..., 2) at its samples."""
    start = (rows(*SOUGHT) + FIRST).unsqueeze(-1)
    plant = Regression()
    scenario = mt.Scenario(NOTHING, plant.parameters_of(theta=SOUGHT), horizon)
    loop = mt.ClosedLoop(plant, Estimator(law, start=start))
    with torch.no_grad():
        run = mt.rollout(
            *(loop, scenario, mt.RungeKutta(step)), sample_dt=every, sample_until=horizon,
            engine=engine,
        )  # fmt: skip
    return run, run.states.controller.theta[..., 0] - rows(*SOUGHT)


def close(found: Tensor, known: Tensor, rtol: float = 1e-6) -> None:
    torch.testing.assert_close(found, known, rtol=rtol, atol=0)


def filtered(t: Tensor, rate: float) -> Tensor:
    """Integral of exp(-rate (t - s)) phi phi' over s from 0 to t (..., 2, 2)."""
    turning = (torch.exp(2j * t) - torch.exp(-rate * t)) / complex(rate, 2.0)
    weight = -torch.expm1(-rate * t) / rate if rate else t
    top = torch.stack([weight - turning.real, turning.imag], dim=-1)
    return 0.5 * torch.stack([top, torch.stack([turning.imag, weight + turning.real], -1)], -2)


@pytest.mark.parametrize("engine", ENGINES)
def test_gradient(engine: str) -> None:
    gamma = [0.5, 1.0, 2.0]
    law = AdaptiveLaw(ConstantGain())
    law.initialize(adaptation_rate=gamma)
    run, error = estimated(law, 20.0, engine, 1.0)
    for j, rate in enumerate(gamma):
        for k, t in enumerate(run.sample_t.tolist()):
            c, s = math.cos(t), math.sin(t)
            free = torch.matrix_exp(rows([0.0, -1.0], [1.0, -rate]) * t) @ FIRST
            close(error[k, j], rows([c, s], [-s, c]) @ free)
    close(error[-1, 1], rows(3.629456e-5, -7.191027e-5), 2e-7)
    # Poles s^2 + gamma s + 1: gamma = 2 is fastest.
    assert int(error[-1].norm(dim=-1).argmin()) == 2


@pytest.mark.parametrize("engine", ENGINES)
def test_least_squares_with_and_without_forgetting(engine: str) -> None:
    forgetting = [0.0, 0.3, 1.0]
    law = AdaptiveLaw(LeastSquares(100.0, forgetting=rows(*forgetting)))
    run, error = estimated(law, 5.0, engine, 0.5, 5e-4)
    P = run.states.controller.laws.gain.P
    first = 0.01 * torch.eye(2, dtype=torch.float64)
    for j, rate in enumerate(forgetting):
        gone = torch.exp(-rate * run.sample_t)[:, None, None]
        known = torch.linalg.inv(gone * first + filtered(run.sample_t, rate))
        close(P[:, j], known)
        close(error[:, j], (gone * known @ first) @ FIRST)
    torch.testing.assert_close(error[-1, 0], rows(0.00239606, 0.00796058), rtol=0, atol=5e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_drem(engine: str) -> None:
    rate, gamma = 0.95, 10.0
    run, error = estimated(Drem(gamma, rate), 40.0, engine, 0.1, 1e-2)
    found = adjugate_and_determinant(run.states.controller.laws.Phi)[1]
    torch.testing.assert_close(
        found, torch.linalg.det(filtered(run.sample_t, rate)), rtol=1e-6, atol=1e-12
    )
    assert abs(float(found[10]) - 0.0291433728) <= 5e-11
    last = 1.0 / (rate**2 * (rate**2 + 4.0))
    assert abs(last - 0.2260139196) <= 5e-11
    assert abs(float(found[-1]) / last - 1.0) <= 1e-9
    # theta~_i = theta~_i(0) exp(-gamma int Delta^2): each falls, and their ratio stays.
    assert bool((error.diff(dim=0) <= 0).all()) and bool((error > 0).all())
    assert float(error[-1].max()) < 1e-8 < 1e-3 < float(error[10].min())
    close(error[:200, 1], 2.0 * error[:200, 0])


def test_an_adjugate_is_that_of_singular_matrices_too() -> None:
    generator = torch.Generator().manual_seed(0)
    for n in range(1, 7):
        A = torch.randn(5, n, n, generator=generator, dtype=torch.float64)
        adjugate, determinant = adjugate_and_determinant(A)
        close(determinant, torch.linalg.det(A), 1e-10)
        close(adjugate, determinant[:, None, None] * torch.linalg.inv(A), 1e-9)
    low = torch.outer(FIRST, rows(3.0, -1.0))
    adjugate, determinant = adjugate_and_determinant(low)
    assert float(determinant) == 0.0
    assert torch.equal(adjugate, rows([low[1, 1], -low[0, 1]], [-low[1, 0], low[0, 0]]))
    assert not bool(adjugate_and_determinant(torch.zeros(3, 3, dtype=torch.float64))[0].any())


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_a_frozen_stack(engine: str) -> None:
    """theta~ = expm(-Gamma Z t) theta~(0): nothing else drives within so wide a dead zone."""
    points = rows([1.0, 0.5], [-0.3, 2.0], [0.7, 0.1])
    gain = rows([1.0, 0.3], [0.3, 0.5])
    stack = ConcurrentLearning(0.4, points=points, labels=points @ rows(*SOUGHT).unsqueeze(-1))
    law = AdaptiveLaw(stack, ConstantGain(gain), DeadZone(1e3))
    run, error = estimated(law, 2.0, engine, 0.25)
    Z = 0.4 * points.mT @ points
    for k, t in enumerate(run.sample_t.tolist()):
        close(error[k], torch.matrix_exp(-gain @ Z * t) @ FIRST)


class Offset(NamedTuple):
    theta: Tensor  # (..., 1, 1)


class OffsetControl(mt.Controller):
    """u = theta, moved by a law on phi = 1."""

    def __init__(self, law: Law) -> None:
        super().__init__()
        self.law = law

    def initial_state(
        self, reference: Any, measurement: Any, batch_shape: Sequence[int], generator: Any = None,
        weights: Any = None,
    ) -> Any:  # fmt: skip
        return Offset(torch.zeros(*batch_shape, 1, 1, dtype=torch.float64)), None

    def forward(self, reference: Any, measurement: Any, state: Any, mode: Any) -> mt.ControlOutput:
        error = reference.value - measurement.y
        drive = Drive.of_features(torch.ones_like(error), error, error.abs()[..., 0])
        rate, _ = self.law(drive, state.theta, None)
        return mt.ControlOutput(state.theta[..., 0], Offset(rate), None)


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_sigma_modification(engine: str) -> None:
    """x' = -a x + d - th, th' = gamma (x - sigma th); the input's theta is -th."""
    a, d, gamma, sigma = 0.8, 1.5, 4.0, 0.5
    plant = LinearPlant([[-a]], [[1.0]], [[1.0]])
    law = AdaptiveLaw(ConstantGain(gamma), SigmaModification(sigma))
    scenario = mt.Scenario(
        NOTHING, plant.parameters_of(), 8.0, disturbance=Disturbance(Polynomial([[d]]))
    )
    with torch.no_grad():
        run = mt.rollout(
            *(mt.ClosedLoop(plant, OffsetControl(law)), scenario, mt.RungeKutta(1e-2)),
            sample_dt=1.0, engine=engine,
        )  # fmt: skip
    moves = rows([-a, -1.0], [gamma, -gamma * sigma])
    rest = rows(sigma * d / (1 + a * sigma), d / (1 + a * sigma))
    found = torch.cat([run.states.plant.x, -run.states.controller.theta[..., 0]], dim=-1)
    for k, t in enumerate(run.sample_t.tolist()):
        known = rest - torch.matrix_exp(moves * t) @ rest
        torch.testing.assert_close(found[k], known, rtol=1e-6, atol=1e-12)
    assert float((found[-1] / rest - 1.0).abs().max()) < 1e-3
    poles = torch.linalg.eigvals(moves)
    assert torch.allclose(poles.sum().real, rows(-(a + gamma * sigma)))
    assert torch.allclose(poles.prod().real, rows(gamma * (1 + a * sigma)))
