"""A cart that balances a pole."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, choice, number
from ..domains import NonNegative, Positive
from ..errors import DomainError
from ..types import Channel, PlantState
from .mechanical import MechanicalPlant, two_by_two
from .plant import Field

_OUTPUTS = {"position": Channel("position", "m"), "angle": Channel("angle", "rad")}


class CartPoleParameters(NamedTuple):
    """Physical parameters, a number each."""

    cart: Tensor  # (..., 1) mass m_c [kg]
    pole: Tensor  # (..., 1) mass m_p [kg]
    length: Tensor  # (..., 1) l from the pivot to the pole's centre of mass [m]
    inertia: Tensor  # (..., 1) I about the centre of mass [kg m^2]
    cart_friction: Tensor  # (..., 1) viscous [N s/m]
    pole_friction: Tensor  # (..., 1) viscous [N m s/rad]


_FIELDS = {
    "cart": Field((1.0,), Positive(), "kg"),
    "pole": Field((0.1,), Positive(), "kg"),
    "length": Field((0.5,), Positive(), "m"),
    "inertia": Field((0.0,), NonNegative(), "kg m^2"),
    "cart_friction": Field((0.0,), NonNegative(), "N s/m"),
    "pole_friction": Field((0.0,), NonNegative(), "N m s/rad"),
}


class CartPole(MechanicalPlant):
    """The cart's position x [m] and the pole's angle theta [rad], 0 upright, > 0 towards +x.

    M = [[m_c + m_p, m_p l cos], [m_p l cos, I + m_p l^2]], C = [[0, -m_p l sin dtheta/dt], [0, 0]],
    N = (b_c dx/dt, b_p dtheta/dt - m_p g l sin); the one input is the force on the cart [N].
    Source: Lagrange's equations; Barto, Sutton and Anderson 1983 is the case I = m_p l^2 / 3.

    `followed` says what is to follow a reference: "both", "position" or "angle"; both are measured.
    `gravity` [m/s^2]. Raises `ConfigError`, `DomainError` or `KindError`.
    """

    n_joints = 2
    Parameters = CartPoleParameters
    fields = _FIELDS

    def __init__(self, followed: str = "both", gravity: float = 9.81) -> None:
        super().__init__()
        self.followed = choice("followed", followed, ("both", *_OUTPUTS))
        number("gravity", gravity, NONNEGATIVE, DomainError)
        self.gravity = gravity  # as it came: a tensor keeps its gradient

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The force on the cart."""
        return (Channel("force", "N"),)

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """What `followed` says."""
        if self.followed == "both":
            return tuple(_OUTPUTS.values())
        return (_OUTPUTS[self.followed],)

    def output(self, state: PlantState, coefficients: CartPoleParameters) -> Tensor:
        """Position, angle or both, (..., 1) or (..., 2)."""
        if self.followed == "both":
            return state.q
        return state.q[..., :1] if self.followed == "position" else state.q[..., 1:]

    def mass_matrix(self, q: Tensor, coefficients: CartPoleParameters) -> Tensor:
        """M(q) (..., 2, 2) [kg, kg m, kg m^2]."""
        cart, pole, length, inertia = (row[..., 0] for row in coefficients[:4])
        arm = pole * length
        off = arm * torch.cos(q[..., 1])
        return two_by_two(cart + pole, off, off, inertia + arm * length)

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: CartPoleParameters) -> Tensor:
        """C(q, qd) (..., 2, 2)."""
        arm = coefficients.pole[..., 0] * coefficients.length[..., 0]
        pull = -arm * torch.sin(q[..., 1]) * qd[..., 1]
        zero = torch.zeros_like(pull)
        return two_by_two(zero, pull, zero, zero)

    def load(self, q: Tensor, qd: Tensor, coefficients: CartPoleParameters) -> Tensor:
        """Gravity and friction (..., 2) [N, N m]."""
        fall = self._weight(coefficients) * torch.sin(q[..., 1])
        gravity = torch.stack([torch.zeros_like(fall), -fall], dim=-1)
        return gravity + self.load_slope(q, qd, coefficients) * qd

    def load_slope(self, q: Tensor, qd: Tensor, coefficients: CartPoleParameters) -> Tensor:
        """Viscous friction (..., 2)."""
        rows = torch.broadcast_tensors(coefficients.cart_friction, coefficients.pole_friction)
        return torch.cat(rows, dim=-1)

    def input_matrix(self, q: Tensor, coefficients: CartPoleParameters) -> Tensor:
        """The force acts on the cart: (..., 2, 1)."""
        column = torch.stack([torch.ones_like(q[..., 0]), torch.zeros_like(q[..., 0])], dim=-1)
        return column.unsqueeze(-1)

    def energy(self, state: PlantState, coefficients: CartPoleParameters) -> Tensor:
        """Kinetic plus potential energy (...,) [J]."""
        potential = self._weight(coefficients) * torch.cos(state.q[..., 1])
        return self.kinetic_energy(state, coefficients) + potential

    def points(self, q: Tensor, parameters: CartPoleParameters) -> Tensor:
        """The pivot on the cart and the pole's centre of mass (..., 2, 2) [m]."""
        pivot = torch.stack([q[..., 0], torch.zeros_like(q[..., 0])], dim=-1)
        along = torch.stack([torch.sin(q[..., 1]), torch.cos(q[..., 1])], dim=-1)
        return torch.stack([pivot, pivot + parameters.length * along], dim=-2)

    def _weight(self, coefficients: CartPoleParameters) -> Tensor:
        """m_p g l (...,) [N m]."""
        return self.gravity * coefficients.pole[..., 0] * coefficients.length[..., 0]
