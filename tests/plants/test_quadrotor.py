"""The planar quadrotor against the problem's equations in NumPy, and its energy."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from mann_torch.plants import PlanarQuadrotor
from mann_torch.types import PlantState
from tests.conftest import randn
from tests.plants.motion import energy_drift, moved


def acceleration(q: np.ndarray, v: np.ndarray, u: np.ndarray, w: float) -> np.ndarray:
    """Problem 1 of the benchmarks, written from its text."""
    phi = q[2]
    B = np.array([[-np.sin(phi), 0, np.cos(phi)], [np.cos(phi), 0, np.sin(phi)], [0.0, 1.0, 0.0]])
    R = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
    through = R.T @ np.array([v[0] - w, v[1]])
    drag = R @ (np.array([0.1, 1.0]) * through * np.abs(through))
    return B @ u - np.array([0.0, 9.81, 0.0]) - np.append(drag, 0.0)


@pytest.mark.parametrize("windy", [True, False])
def test_equations_are_the_problems(windy: bool) -> None:
    plant = PlanarQuadrotor()
    q, qd, u = 2 * randn(3, 30, 3)
    wind = 6.5 * randn(30, 1, seed=1)
    t = torch.zeros(30, dtype=torch.float64)
    found = plant.derivative(
        t, PlantState(q, qd), plant.grouped(u), wind if windy else None, plant.parameters_of()
    )
    known = [
        acceleration(*(x[i].numpy() for x in (q, qd, u)), float(wind[i]) if windy else 0.0)
        for i in range(30)
    ]
    np.testing.assert_allclose(found.qd.numpy(), np.array(known), rtol=1e-12, atol=1e-11)
    assert torch.equal(found.q, qd)


def test_still_air_is_wind_of_no_speed() -> None:
    plant = PlanarQuadrotor()
    q, qd, u = randn(3, 5, 3)
    t = torch.zeros(5, dtype=torch.float64)
    rates = [
        plant.derivative(t, PlantState(q, qd), plant.grouped(u), wind, plant.parameters_of()).qd
        for wind in (None, torch.zeros(5, 1, dtype=torch.float64))
    ]
    assert torch.equal(*rates)


def test_without_drag_it_keeps_its_energy_and_drag_takes_it() -> None:
    start = [0.0, 1.0, 0.3, 2.0, 3.0, -0.5]
    assert energy_drift(PlanarQuadrotor(), start, 2.0, drag=[0.0, 0.0]) <= 1e-10
    plant = PlanarQuadrotor()
    states = moved(plant, plant.parameters_of(), start, np.linspace(0.0, 2.0, 41))
    energy = plant.energy(states, plant.parameters_of())
    assert bool((energy.diff() < 0).all())


def test_it_drifts_to_the_speed_of_the_wind() -> None:
    """At a hover with phi = 0 the wind pushes until there is none to feel."""
    plant, p = PlanarQuadrotor(), PlanarQuadrotor().parameters_of()
    t = torch.zeros((), dtype=torch.float64)
    hover = torch.tensor([9.81, 0.0, 0.0], dtype=torch.float64)
    wind = torch.tensor([6.5], dtype=torch.float64)
    state = PlantState(torch.zeros(3).double(), torch.tensor([6.5, 0.0, 0.0]).double())
    still = plant.derivative(t, state, plant.grouped(hover), wind, p).qd
    assert float(still.abs().max()) <= 1e-14
    pushed = plant.derivative(t, plant.rest(), plant.grouped(hover), wind, p).qd
    assert pushed.tolist() == pytest.approx([0.1 * 6.5**2, 0.0, 0.0], abs=1e-12)


def test_one_sample_may_have_its_own_drag() -> None:
    plant = PlanarQuadrotor()
    p = plant.parameters_of(drag=[[0.1, 1.0], [0.2, 2.0]])
    qd = torch.tensor([[1.0, 0.0, 0.0]] * 2, dtype=torch.float64)
    state = PlantState(torch.zeros(2, 3, dtype=torch.float64), qd)
    t, none = torch.zeros(2, dtype=torch.float64), torch.zeros(2, 3, dtype=torch.float64)
    rate = plant.derivative(t, state, plant.grouped(none), None, p).qd
    assert rate[:, 0].tolist() == [-0.1, -0.2]
