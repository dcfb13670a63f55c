"""Cart and pole: Lagrange's equations, energy, small motions."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from mann_torch.errors import ConfigError
from mann_torch.plants import CartPole
from mann_torch.types import PlantState
from tests.conftest import randn
from tests.plants.motion import energy_drift, moved

BODY = {"cart": [1.3], "pole": [0.4], "length": [0.6], "inertia": [0.05]}


def test_forces_are_lagranges_of_where_the_masses_are() -> None:
    plant = CartPole()
    c = plant.coefficients(plant.parameters_of(**BODY))

    def lagrangian(x: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
        def places(x: torch.Tensor) -> torch.Tensor:
            return torch.stack([x[0], x[0] + 0.6 * torch.sin(x[1]), 0.6 * torch.cos(x[1])])

        _, speed = torch.func.jvp(places, (x,), (v,))
        kinetic = 0.5 * (1.3 * speed[0] ** 2 + 0.4 * (speed[1] ** 2 + speed[2] ** 2))
        return kinetic + 0.025 * v[1] ** 2 - 0.4 * 9.81 * places(x)[2]

    q, qd, qdd = randn(2), randn(2, seed=1), randn(2, seed=2)
    momentum = lambda x, v: torch.func.grad(lagrangian, 1)(x, v)  # noqa: E731
    _, rate = torch.func.jvp(momentum, (q, qd), (qd, qdd))
    owed = rate - torch.func.grad(lagrangian, 0)(q, qd)
    found = plant.mass_matrix(q, c) @ qdd + plant.coriolis(q, qd, c) @ qd + plant.load(q, qd, c)
    torch.testing.assert_close(found, owed, rtol=1e-12, atol=1e-12)


def test_free_it_keeps_energy_and_momentum() -> None:
    start = [0.1, 0.4, -0.2, 0.6]
    assert energy_drift(CartPole(), start, 3.0, **BODY) <= 1e-9
    plant = CartPole()
    parameters = plant.parameters_of(**BODY)
    states = moved(plant, parameters, start, np.linspace(0.0, 3.0, 31))
    M = plant.mass_matrix(states.q, plant.coefficients(parameters))
    along_x = (M[:, 0] * states.qd).sum(-1)  # no force acts along the rail
    assert float((along_x - along_x[0]).abs().max()) <= 1e-9


def test_published_acceleration_of_a_uniform_pole() -> None:
    """Barto, Sutton and Anderson 1983: m = 0.1, M = 1, half length 0.5, g = 9.8, no friction."""
    plant = CartPole(gravity=9.8)
    c = plant.coefficients(plant.parameters_of(inertia=[0.1 * 0.5**2 / 3]))
    theta, rate, force = 0.3, -0.7, 10.0
    cos, sin, total = math.cos(theta), math.sin(theta), 1.1
    push = (force + 0.1 * 0.5 * rate**2 * sin) / total
    turn = (9.8 * sin - cos * push) / (0.5 * (4 / 3 - 0.1 * cos**2 / total))
    run = push - 0.1 * 0.5 * turn * cos / total
    state = PlantState(
        torch.tensor([0.2, theta], dtype=torch.float64),
        torch.tensor([0.5, rate], dtype=torch.float64),
    )
    input = plant.grouped(torch.tensor([force], dtype=torch.float64))
    found = plant.derivative(torch.zeros(()), state, input, None, c).qd
    assert found.tolist() == pytest.approx([run, turn], rel=1e-12)


def test_upright_is_unstable_and_hanging_swings_at_the_closed_forms_frequency() -> None:
    plant = CartPole()
    c = plant.coefficients(plant.parameters_of(**BODY))
    t, none = torch.zeros((), dtype=torch.float64), plant.grouped(torch.zeros(1).double())

    def stiffness(angle: float) -> torch.Tensor:
        def accelerated(q: torch.Tensor) -> torch.Tensor:
            return plant.derivative(t, PlantState(q, torch.zeros_like(q)), none, None, c).qd

        at = torch.tensor([0.0, angle], dtype=torch.float64)
        return torch.func.jacrev(accelerated)(at)[1, 1]

    total, inertia, arm = 1.7, 0.05 + 0.4 * 0.36, 0.4 * 0.6
    square = arm * 9.81 * total / (total * inertia - arm**2)
    assert float(stiffness(0.0)) == pytest.approx(square, rel=1e-12)
    assert float(stiffness(math.pi)) == pytest.approx(-square, rel=1e-12)


def test_what_follows_is_what_is_asked_for() -> None:
    state = PlantState(randn(3, 2), randn(3, 2, seed=1))
    for followed, names in (
        ("both", ["position", "angle"]),
        ("position", ["position"]),
        ("angle", ["angle"]),
    ):
        plant = CartPole(followed)
        assert [channel.name for channel in plant.outputs] == names
        columns = [["position", "angle"].index(name) for name in names]
        assert torch.equal(plant.output(state, plant.parameters_of()), state.q[:, columns])
    with pytest.raises(ConfigError, match=r"followed.*choose from"):
        CartPole("speed")
