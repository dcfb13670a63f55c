"""The pendulum's period, energy and friction."""

from __future__ import annotations

import math

import numpy as np
import torch
from scipy.integrate import simpson, solve_ivp
from scipy.special import ellipk

from mann_torch.plants import Pendulum
from mann_torch.types import PlantState
from tests.plants.motion import energy_drift, moved, rate_of


def test_period_of_a_large_swing_is_the_elliptic_integrals() -> None:
    plant, swing = Pendulum(), 2.0
    values = {"mass": [0.7], "length": [0.4], "inertia": [0.02]}
    _, rate = rate_of(plant, plant.parameters_of(**values), lambda t: [0.0])
    crossing = lambda t, y: y[0]  # noqa: E731
    solved = solve_ivp(
        rate, (0.0, 6.0), [swing, 0.0], "DOP853", rtol=1e-11, atol=1e-12, events=crossing
    )
    half = float(np.diff(solved.t_events[0])[0])
    slow = math.sqrt((0.02 + 0.7 * 0.16) / (0.7 * 9.81 * 0.4))
    assert math.isclose(2 * half, 4 * slow * ellipk(math.sin(swing / 2) ** 2), rel_tol=1e-9)


def test_free_it_keeps_its_energy() -> None:
    assert energy_drift(Pendulum(), [1.0, 4.0], 5.0) <= 1e-10


def test_friction_takes_the_energy_that_is_missing() -> None:
    """The ledger: the energy lost is the integral of friction times rate."""
    plant = Pendulum(coulomb_velocity=0.5)
    parameters = plant.parameters_of(viscous=[0.2], coulomb=[0.3])
    times = np.linspace(0.0, 4.0, 801)
    states = moved(plant, parameters, [2.0, 0.0], times)
    energy = plant.energy(states, plant.coefficients(parameters))
    rate = states.qd[:, 0].numpy()
    friction = 0.2 * rate + 0.3 * np.tanh(rate / 0.5)
    lost = float(simpson(friction * rate, x=times))
    assert math.isclose(float(energy[0] - energy[-1]), lost, rel_tol=1e-8)


def test_hanging_still_is_rest() -> None:
    plant = Pendulum()
    c = plant.coefficients(plant.parameters_of())
    t, none = torch.zeros((), dtype=torch.float64), plant.grouped(torch.zeros(1).double())
    assert plant.derivative(t, plant.rest(), none, None, c).qd.tolist() == [0.0]
    assert float(plant.energy(plant.rest(), c)) == 0.0
    level = PlantState(torch.full((1,), math.pi / 2).double(), torch.zeros(1).double())
    held = plant.grouped(plant.load(*level, c))
    assert float(plant.derivative(t, level, held, None, c).qd.abs()) <= 1e-15
