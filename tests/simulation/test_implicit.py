"""Order and stability of the W-method."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from torch import Tensor

import mann_torch as mt
from mann_torch.simulation.step_grid import StepGrid
from mann_torch.stiff import SecondOrderBlock


class Follower:
    """qdd = -p(t) (qd - cos t) - k sin(q - sin t) - sin t, p(t) = p (1 + wobble sin 5t).

    The block given to the solver is inexact: `guess` times p, k and p's own motion left out.
    """

    def __init__(self, p: float, k: float, guess: float, wobble: float = 0.0) -> None:
        self.p, self.k, self.guess, self.wobble = p, k, guess, wobble

    def __call__(self, t: Tensor, y: Tensor) -> Tensor:
        q, qd = y.unbind(-1)
        p = self.p * (1 + self.wobble * torch.sin(5 * t))
        rate = -p * (qd - torch.cos(t)) - self.k * torch.sin(q - torch.sin(t)) - torch.sin(t)
        return torch.stack([qd, rate], dim=-1)

    def linearized(self, t: Tensor, y: Tensor) -> tuple[Tensor, SecondOrderBlock]:
        one = torch.ones(1, 1, dtype=torch.float64)
        p = self.guess * self.p
        return self(t, y), SecondOrderBlock(0 * one, p * one, -p * torch.sin(t).reshape(1))


def integrate(flow: Follower, y0: list[float], end: float, h: float) -> Tensor:
    y = torch.tensor(y0, dtype=torch.float64)
    solver, times = mt.Implicit(h, follow_reference=True), StepGrid(end, [], h).times
    for t, step in zip(times[:-1], times.diff(), strict=True):
        y = solver.step(flow, t, step, y)
    return y


@pytest.mark.parametrize("guess", [1.0, 0.6, 0.0])
def test_order_two_on_a_non_autonomous_problem_with_an_inexact_matrix(guess: float) -> None:
    flow = Follower(p=8.0, k=5.0, guess=guess, wobble=0.3)
    y0, end = [0.4, 0.2], 2.0
    rate = lambda t, y: flow(torch.tensor(t), torch.from_numpy(y)).numpy()  # noqa: E731
    exact = solve_ivp(rate, (0, end), y0, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    steps = [0.02 / 2**k for k in range(5)]
    errors = [float(np.abs(integrate(flow, y0, end, h).numpy() - exact).max()) for h in steps]
    slope = np.polyfit(np.log2(steps), np.log2(errors), 1)[0]
    assert abs(slope - 2.0) <= 0.15, (slope, errors)


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6])
def test_a_stiff_follower_is_as_accurate_as_a_mild_one(stiffness: float) -> None:
    def errors(p: float, h: float) -> np.ndarray:
        y = integrate(Follower(p, 1.0, 1.0), [0.0, 1.0], 2.0, h)
        return np.abs(y.numpy() - [math.sin(2.0), math.cos(2.0)])

    coarse, fine = errors(stiffness, 1e-2), errors(stiffness, 5e-3)
    assert coarse.max() <= 10 * errors(1.0, 1e-2).max()
    assert (fine <= coarse / 3.5).all()  # second order, velocities included


def test_a_fast_transient_is_damped_in_one_step() -> None:
    flow = Follower(p=1e6, k=0.0, guess=1.0)
    y = integrate(flow, [0.0, 101.0], 1e-2, 1e-2)
    # 100 rad/s off the slow motion; L-stability leaves at most 1 % of it after one step.
    assert abs(float(y[1]) - math.cos(1e-2)) <= 1.0


@pytest.mark.parametrize("bad", [0.0, -1e-3, float("nan"), float("inf")])
def test_bad_steps_are_refused(bad: float) -> None:
    with pytest.raises(mt.ConfigError, match="dt"):
        mt.Implicit(bad)
    with pytest.raises(mt.ConfigError, match="dt"):
        mt.Odeint("rk4", bad)
