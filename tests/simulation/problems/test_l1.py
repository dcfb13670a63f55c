"""Problem 8: L1 adaptive control, its norms, its responses, and the piecewise-constant law."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from torch import Tensor

import mann_torch as mt
from mann_torch.control import (
    AdaptiveLaw,
    BoxProjection,
    ConstantGain,
    Controller,
    Identity,
    L1Adaptive,
    LinearNetwork,
    Mrac,
    l1_gain,
)
from mann_torch.plants import LinearPlant
from mann_torch.signals import Disturbance, Polynomial

A_M, B = [[0.0, 1.0], [-1.0, -1.4]], [[0.0], [1.0]]
THETA = (4.0, -4.5)
UNCERTAIN = LinearPlant([[0.0, 1.0], [-1.0 + THETA[0], -1.4 + THETA[1]]], B, [[1.0, 0.0]], "state")


@pytest.mark.parametrize(
    ("bandwidth", "rows", "times_20"),
    [(30.0, [0.032027, 0.071871], 1.437), (160.0, [0.006008, 0.014740], 0.295)],
)
def test_norms_are_the_known_ones(bandwidth: float, rows: list[float], times_20: float) -> None:
    found = l1_gain(A_M, B, bandwidth)[:, 0]
    torch.testing.assert_close(found, torch.tensor(rows).double(), rtol=0, atol=5e-7)
    assert abs(20.0 * float(found.max()) - times_20) <= 5e-4


def steps(
    sizes: list[float], controller: Controller, dt: float, horizon: float, engine: str = "compiled"
) -> mt.Trajectory:
    # MRAC follows the model; L1's command is the reference itself.
    model = mt.LinearModel(A_M, B, [[1.0, 0.0]]) if isinstance(controller, Mrac) else None
    loop = mt.ClosedLoop(UNCERTAIN, controller, model=model)
    rows = torch.tensor(sizes, dtype=torch.float64).reshape(-1, 1, 1)
    scenario = mt.Scenario(Polynomial(rows), UNCERTAIN.parameters_of(), horizon)
    with torch.no_grad():
        return mt.rollout(
            loop, scenario, mt.RungeKutta(dt), sample_dt=0.1, motion_dt=0.05, engine=engine
        )


def test_responses_to_steps_are_scaled_copies() -> None:
    """Of 25, 100 and 400: explicit, since estimates ring at 3e4 rad/s at a step of 400."""
    sizes = [25.0, 100.0, 400.0]
    run = steps(sizes, L1Adaptive(A_M, B, bandwidth=160.0), 1e-5, 10.0)
    assert run.status.tolist() == [0, 0, 0]
    scaled = run.output[..., 0] / torch.tensor(sizes).double()
    assert float((scaled - scaled[:, :1]).abs().max()) <= 5e-5
    # They settle to the command, as the model does, and estimates stay in their box.
    torch.testing.assert_close(scaled[-1], torch.ones(3).double(), rtol=0, atol=2e-3)
    assert float(run.states.controller.adaptation.estimate.abs().max()) <= 10.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mrac", "l1"])
def test_slow_estimates_do_not_scale(kind: str) -> None:
    """What makes them copies is the gain. At 1e4, MRAC's, too, are within 3e-7 of each other.

    At 0.01 neither's are: that of 25 and that of 400 are more than 0.25 apart.
    """
    sizes = torch.tensor([25.0, 100.0, 400.0], dtype=torch.float64)
    gaps = []
    for gain, dt in ((1e4, 1e-5), (0.01, 1e-3)):
        law = AdaptiveLaw(ConstantGain(gain), BoxProjection(10.0))
        if kind == "mrac":
            network = LinearNetwork(Identity(3), 1, law)
            controller = Mrac.of_model(A_M, B, network, feedforward=[[1.0]])
        else:
            controller = L1Adaptive(A_M, B, law, bandwidth=160.0)
        run = steps(sizes.tolist(), controller, dt, 10.0)
        scaled = run.output[..., 0] / sizes
        gaps.append(float((scaled - scaled[:, :1]).abs().max()))
    assert gaps[0] <= (3e-7 if kind == "mrac" else 5e-5)
    assert gaps[1] > 0.25


def by_hand(t: float, z: np.ndarray, r: float, w: float, bound: float = 10.0) -> np.ndarray:
    """The loop's equations, one by one, with A_m'P + P A_m = -1 solved by hand."""
    x_1, x_2, p_1, p_2, u, *theta = z
    e_1, e_2 = p_1 - x_1, p_2 - x_2
    P_12 = 0.5
    P_22 = (2 * P_12 + 1.0) / 2.8
    through = P_12 * e_1 + P_22 * e_2
    rates = []
    for estimate, x in zip(theta, (x_1, x_2), strict=True):
        y = -1e4 * x * through
        f = (1.1 * estimate**2 - bound**2) / (0.1 * bound**2)
        rates.append(y * (1 - f) if f > 0 and estimate * y > 0 else y)
    eta = theta[0] * x_1 + theta[1] * x_2
    acting = u + THETA[0] * x_1 + THETA[1] * x_2
    return np.array(
        [
            x_2, -x_1 - 1.4 * x_2 + acting,
            p_2, -p_1 - 1.4 * p_2 + u + eta,
            w * (r - eta - u), *rates,
        ]
    )  # fmt: skip


@pytest.mark.parametrize(
    ("engine", "dt", "close"),
    [("compiled", 1e-5, 1e-8), pytest.param("torch", 1e-4, 1e-4, marks=pytest.mark.slow)],
)
def test_it_solves_the_equations_written_out(engine: str, dt: float, close: float) -> None:
    run = steps([25.0], L1Adaptive(A_M, B, bandwidth=160.0), dt, 0.5, engine)
    found = solve_ivp(
        by_hand, (0.0, 0.5), np.zeros(7), "DOP853", rtol=1e-12, atol=1e-12, args=(25.0, 160.0)
    ).y[:, -1]
    end = run.states
    ours = [end.plant.x, end.controller.predicted, end.controller.input]
    ours.append(end.controller.adaptation.estimate[..., 0])
    flat = torch.cat([rows[-1, 0] for rows in ours])
    torch.testing.assert_close(flat, torch.from_numpy(found), rtol=close, atol=close)


def sampled(
    A: list[list[float]], b: list[list[float]], push: list[float], engine: str, period: float
) -> mt.Trajectory:
    """With a constant push on the state's rate, which the controller does not know of."""
    d = len(A)
    plant = LinearPlant(A, b, torch.eye(d, dtype=torch.float64)[:1], "state")
    loop = mt.ClosedLoop(plant, L1Adaptive(A, b, period=period, bandwidth=20.0))
    scenario = mt.Scenario(
        Polynomial([[1.0]]), plant.parameters_of(), 5.5 * period,
        disturbance=Disturbance(state=Polynomial([push])),
    )  # fmt: skip
    with torch.no_grad():
        return mt.rollout(
            loop, scenario, mt.RungeKutta(period / 20), sample_dt=period, engine=engine
        )


def prediction_error(run: mt.Trajectory) -> Tensor:
    return run.states.controller.predicted - run.states.plant.x


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_a_constant_is_found_by_the_first_sample(engine: str) -> None:
    """sigma^ = exp(a T) sigma and x~ = -b sigma (exp(a T) - 1) / a from the first on."""
    a, b, sigma, T = -1.5, 2.0, 0.7, 0.02
    run = sampled([[a]], [[b]], [b * sigma], engine, T)
    estimates = run.modes.sigma[2:, 0]  # as it was before the decisions at kT
    grown = math.exp(a * T)
    torch.testing.assert_close(
        estimates, torch.full_like(estimates, grown * sigma), rtol=1e-9, atol=0
    )
    error = prediction_error(run)[1:-1, 0]
    known = torch.full_like(error, -b * sigma * (grown - 1.0) / a)
    torch.testing.assert_close(error, known, rtol=1e-9, atol=0)


def test_so_is_a_vector_across_the_inputs_too() -> None:
    """sigma^ = B+^-1 exp(A T) B+ sigma, matched or not: here B+ is [B, (1, 0)]."""
    push, T = torch.tensor([0.3, -0.5], dtype=torch.float64), 0.02
    run = sampled(A_M, B, push.tolist(), "compiled", T)
    grown = torch.matrix_exp(T * torch.tensor(A_M, dtype=torch.float64)) @ push
    controller = L1Adaptive(A_M, B, period=T)
    whole = controller.adaptation.whole
    torch.testing.assert_close(whole @ run.modes.sigma[-2], grown, rtol=1e-9, atol=0)
    torch.testing.assert_close(run.modes.sigma[-2, 0], grown[1], rtol=1e-9, atol=0)
