"""A pendulum that a torque turns."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, POSITIVE, number
from ..domains import NonNegative, Positive
from ..errors import DomainError
from ..types import PlantState
from .friction import friction_slope, unless_zero, with_friction
from .mechanical import MechanicalPlant
from .plant import Field


class PendulumParameters(NamedTuple):
    """Physical parameters, a number each."""

    mass: Tensor  # (..., 1) m [kg]
    length: Tensor  # (..., 1) l from the pivot to the centre of mass [m]
    inertia: Tensor  # (..., 1) I about the centre of mass [kg m^2]
    viscous: Tensor  # (..., 1) [N m s/rad]
    coulomb: Tensor  # (..., 1) [N m]


class PendulumCoefficients(NamedTuple):
    """What the equation of motion needs."""

    inertia: Tensor  # (..., 1) about the pivot [kg m^2]
    weight: Tensor  # (..., 1) m g l [N m]
    viscous: Tensor | None  # (..., 1); None without friction
    coulomb: Tensor | None  # (..., 1)


_FIELDS = {
    "mass": Field((1.0,), Positive(), "kg"),
    "length": Field((1.0,), Positive(), "m"),
    "inertia": Field((0.0,), NonNegative(), "kg m^2"),
    "viscous": Field((0.0,), NonNegative(), "N m s/rad"),
    "coulomb": Field((0.0,), NonNegative(), "N m"),
}


class Pendulum(MechanicalPlant):
    """(I + m l^2) qdd + m g l sin q + friction = torque, with q = 0 hanging down [rad].

    `gravity` g [m/s^2]; Coulomb friction is coulomb tanh(qd / `coulomb_velocity`) [rad/s]. Source:
    Newton's second law. Raises `DomainError` or `KindError`.
    """

    n_joints = 1
    Parameters = PendulumParameters
    fields = _FIELDS

    def __init__(self, gravity: float = 9.81, coulomb_velocity: float = 0.01) -> None:
        super().__init__()
        number("gravity", gravity, NONNEGATIVE, DomainError)
        number("coulomb_velocity", coulomb_velocity, POSITIVE, DomainError)
        # As they came: a tensor keeps its gradient.
        self.gravity, self.coulomb_velocity = gravity, coulomb_velocity

    def coefficients(self, parameters: PendulumParameters) -> PendulumCoefficients:
        """Inertia and weight about the pivot."""
        mass, length, inertia, viscous, coulomb = parameters
        arm = mass * length
        friction = unless_zero(viscous), unless_zero(coulomb)
        return PendulumCoefficients(inertia + arm * length, self.gravity * arm, *friction)

    def mass_matrix(self, q: Tensor, coefficients: PendulumCoefficients) -> Tensor:
        """(..., 1, 1) [kg m^2]."""
        return (torch.zeros_like(q) + coefficients.inertia).unsqueeze(-1)

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: PendulumCoefficients) -> Tensor:
        """0 (..., 1, 1)."""
        return torch.zeros_like(q).unsqueeze(-1)

    def load(self, q: Tensor, qd: Tensor, coefficients: PendulumCoefficients) -> Tensor:
        """Gravity and friction (..., 1) [N m]."""
        gravity = coefficients.weight * torch.sin(q)
        return with_friction(gravity, qd, *coefficients[2:], self.coulomb_velocity)

    def load_slope(
        self, q: Tensor, qd: Tensor, coefficients: PendulumCoefficients
    ) -> Tensor | None:
        """Slope of the friction (..., 1) [N m s/rad]; None without friction."""
        return friction_slope(qd, *coefficients[2:], self.coulomb_velocity)

    def energy(self, state: PlantState, coefficients: PendulumCoefficients) -> Tensor:
        """Kinetic plus potential energy (...,) [J]; 0 at rest."""
        height = (coefficients.weight * (1.0 - torch.cos(state.q)))[..., 0]
        return self.kinetic_energy(state, coefficients) + height

    def points(self, q: Tensor, parameters: PendulumParameters) -> Tensor:
        """The pivot and the centre of mass (..., 2, 2) [m]."""
        mass = parameters.length * torch.cat([torch.sin(q), -torch.cos(q)], dim=-1)
        return torch.stack([torch.zeros_like(mass), mass], dim=-2)
