"""PID against the linear systems that it makes, and its limit."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import Pid
from mann_torch.errors import KindError, ShapeError
from mann_torch.plants import DoubleIntegrator, LinearPlant
from mann_torch.signals import Disturbance, Polynomial

K_P, K_I, K_D, F = 6.0, 2.0, 4.0, 25.0


def stepped(
    pid: Pid, plant: object, horizon: float, push: float = 0.0, dt: float = 1e-3
) -> mt.Trajectory:
    """To 1 from rest, with a constant push on the input."""
    loop = mt.ClosedLoop(plant, pid)  # type: ignore[arg-type]
    scenario = mt.Scenario(
        Polynomial([[1.0]]), plant.parameters_of(), horizon,  # type: ignore[attr-defined]
        disturbance=Disturbance(input=Polynomial([[push]])),
    )  # fmt: skip
    with torch.no_grad():
        return mt.rollout(loop, scenario, mt.RungeKutta(dt), sample_dt=0.1)


def linear(A: list[list[float]], b: list[float], start: list[float], t: Tensor) -> Tensor:
    """The exact solution of x' = A x + b at times t, (T, d)."""
    d = len(A)
    whole = torch.zeros(d + 1, d + 1, dtype=torch.float64)
    whole[:d, :d], whole[:d, d] = (
        torch.tensor(A, dtype=torch.float64),
        torch.tensor(b, dtype=torch.float64),
    )
    begin = torch.tensor([*start, 1.0], dtype=torch.float64)
    return (torch.matrix_exp(whole * t.reshape(-1, 1, 1)) @ begin)[:, :d]


def test_with_measured_rates_it_solves_its_equations() -> None:
    """q'' = K_p (1 - q) + z - K_d q' + 0.7, z' = K_i (1 - q)."""
    run = stepped(Pid(1, K_P, K_I, K_D), DoubleIntegrator(), 2.0, 0.7)
    A = [[0.0, 1.0, 0.0], [-K_P, -K_D, 1.0], [-K_I, 0.0, 0.0]]
    known = linear(A, [0.0, K_P + 0.7, K_I], [0.0, 0.0, 0.0], run.sample_t)
    torch.testing.assert_close(run.states.plant.q[:, 0], known[:, 0], rtol=0, atol=1e-9)
    torch.testing.assert_close(run.states.controller.integral[:, 0], known[:, 2], rtol=0, atol=1e-9)


@pytest.mark.parametrize("of", ["error", "output"])
def test_with_a_filtered_derivative_too(of: str) -> None:
    """d = F (w - x_f), x_f' = d of what is watched, w: 1 - y, or -y, which has the same rate."""
    pid = Pid(1, K_P, K_I, K_D / 8, filter_rate=F, derivative_of=of)
    run = stepped(pid, LinearPlant([[-1.0]], [[1.0]], [[1.0]]), 2.0)
    damping, watched = K_D / 8 * F, 1.0 if of == "error" else 0.0
    A = [[-1.0 - K_P - damping, 1.0, -damping], [-K_I, 0.0, 0.0], [-F, 0.0, -F]]
    b = [K_P + damping * watched, K_I, F * watched]
    known = linear(A, b, [0.0, 0.0, watched], run.sample_t)
    torch.testing.assert_close(run.states.plant.x[:, 0], known[:, 0], rtol=0, atol=1e-9)


def test_the_integral_takes_a_constant_away() -> None:
    run = stepped(Pid(1, K_P, K_I, K_D), DoubleIntegrator(), 40.0, 3.0, 0.01)
    assert abs(float(run.output[-1]) - 1.0) <= 1e-5
    assert abs(float(run.states.controller.integral[-1]) + 3.0) <= 1e-4


def test_what_is_limited_does_not_wind_up() -> None:
    """A step that saturates: less overshoot with back-calculation, and never beyond the limit."""
    pid = Pid(1, K_P, 6.0, filter_rate=F, limit=1.3)
    pid.initialize(unwinding_rate=[[0.0], [20.0]])
    run = stepped(pid, LinearPlant([[-1.0]], [[1.0]], [[1.0]]), 12.0)
    wound, unwound = run.output[..., 0].amax(0).tolist()
    assert 1.1 < wound <= 1.3
    assert unwound < 1.0 + 0.3 * (wound - 1.0), (wound, unwound)


def test_it_refuses_what_it_can_not_measure() -> None:
    with pytest.raises(KindError, match="velocities qd"):
        stepped(Pid(1), LinearPlant([[-1.0]], [[1.0]], [[1.0]]), 0.1)
    with pytest.raises(ShapeError, match="controller of 2"):
        stepped(Pid(2), DoubleIntegrator(), 0.1)
