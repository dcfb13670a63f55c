"""Output MRAC: an unstable plant of second order, whose state nobody sees."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

import mann_torch as mt
from mann_torch import control
from mann_torch.errors import ShapeError
from mann_torch.plants import LinearPlant
from mann_torch.signals import Sinusoid, Sum

#: y = gain (s + zero) / (s^2 + a_1 s + a_0) u: poles at 1 and -2.
GAIN, ZERO, A_1, A_0 = 2.0, 1.5, 1.0, -2.0
FILTER, MODEL, RATE = 1.0, 3.0, 100.0
#: w1, w2, y and r as they give 3 / (s + 3): the zero is cancelled, the poles are moved.
OF_Y = (A_1 - FILTER - MODEL) / GAIN
IDEAL = [
    (FILTER - ZERO) / FILTER,
    (A_0 - MODEL * FILTER) / (GAIN * FILTER) - OF_Y,
    OF_Y,
    MODEL / GAIN,
]
SWINGS = ((1.0, 1.0), (2.0, 3.7))


def run(start: list[float], horizon: float, dt: float = 2e-3) -> mt.Trajectory:
    plant = LinearPlant.from_transfer_function([GAIN, GAIN * ZERO], [1.0, A_1, A_0])
    law = control.AdaptiveLaw(control.ConstantGain(RATE))
    network = control.LinearNetwork(control.Identity(4), 1, law, start=[[x] for x in start])
    controller = control.OutputMrac([FILTER], network)
    loop = mt.ClosedLoop(plant, controller, model=mt.LinearModel.first_order(MODEL))
    signal = Sum([Sinusoid([amplitude], frequency) for amplitude, frequency in SWINGS])
    scenario = mt.Scenario(signal, plant.parameters_of(), horizon)
    with torch.no_grad():
        return mt.rollout(loop, scenario, mt.RungeKutta(dt), sample_dt=1.0)


def test_the_ideal_gains_leave_no_error() -> None:
    found = run(IDEAL, 10.0)
    assert float(found.error.abs().max()) <= 1e-9
    weights = found.states.controller.adaptive.network.W[-1, :, 0]
    assert weights.tolist() == pytest.approx(IDEAL, abs=1e-8)


def test_it_finds_them() -> None:
    """From 0, the plant unstable: two frequencies tell four numbers apart."""
    found = run([0.0] * 4, 400.0)
    late = found.error[found.t >= 390.0].abs().max()
    assert float(late) <= 1e-4 * float(found.error.abs().max())
    weights = found.states.controller.adaptive.network.W[-1, :, 0]
    assert weights.tolist() == pytest.approx(IDEAL, abs=1e-3)


def test_it_moves_as_its_equations_say() -> None:
    """Against SciPy, of the same equations written out."""

    def rates(t: float, z: np.ndarray) -> list[float]:
        x_1, x_2, w_1, w_2, y_m, *theta = z
        y = GAIN * ZERO * x_1 + GAIN * x_2
        r = sum(amplitude * np.sin(frequency * t) for amplitude, frequency in SWINGS)
        omega, e = np.array([w_1, w_2, y, r]), y_m - y
        u = float(omega @ np.array(theta))
        filtered = [FILTER * (u - w_1), FILTER * (y - w_2), MODEL * (r - y_m)]
        return [x_2, -A_0 * x_1 - A_1 * x_2 + u, *filtered, *(RATE * omega * e)]

    solved = solve_ivp(rates, (0.0, 5.0), np.zeros(9), method="DOP853", rtol=1e-11, atol=1e-12)
    found = run([0.0] * 4, 5.0, 5e-4)
    weights = found.states.controller.adaptive.network.W[-1, :, 0]
    assert weights.tolist() == pytest.approx(solved.y[5:, -1].tolist(), rel=1e-7)


def test_a_chain_of_lags_is_controllable_where_rates_are_equal() -> None:
    filters = control.InputOutputFilters([2.0, 2.0, 2.0])
    zero = torch.zeros(3, dtype=torch.float64)
    one = torch.ones(1, dtype=torch.float64)
    state = filters.initial_state(())
    entering = filters.rates(one, one, state).inputs
    columns = [
        filters.rates(0 * one, 0 * one, state._replace(inputs=zero + row)).inputs
        for row in torch.eye(3, dtype=torch.float64)
    ]
    F = torch.stack(columns, dim=-1)
    reached = torch.stack([entering, F @ entering, F @ F @ entering], dim=-1)
    assert int(torch.linalg.matrix_rank(reached)) == 3
    assert torch.linalg.eigvals(F).real.tolist() == pytest.approx([-2.0] * 3, abs=1e-4)


def test_what_does_not_fit_is_named() -> None:
    network = control.LinearNetwork(control.Identity(3), 1)
    with pytest.raises(ShapeError, match="filter_rates of 1 numbers ask for 4 and 1"):
        control.OutputMrac([1.0], network)
    with pytest.raises(ShapeError, match="2 inputs and 1 outputs got output MRAC"):
        control.OutputMrac().check_fit(2, 1)
