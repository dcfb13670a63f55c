"""A quadrotor that moves in a vertical plane, in wind."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..domains import Finite, NonNegative
from ..types import Channel, PlantState
from .mechanical import MechanicalPlant
from .plant import Field


class QuadrotorParameters(NamedTuple):
    """Drag and gravity; masses are in the inputs' units."""

    drag: Tensor  # (..., 2) beta along the body's axes [1/m]
    gravity: Tensor  # (..., 1) [m/s^2]


_FIELDS = {
    "drag": Field((0.1, 1.0), NonNegative(), "1/m"),
    "gravity": Field((9.81,), Finite(), "m/s^2"),
}


class PlanarQuadrotor(MechanicalPlant):
    """Position x, y [m] and pitch phi [rad]: qdd + (0, g, 0) = B(q) u + force of the air.

    B = [[-sin phi, 0, cos phi], [cos phi, 0, sin phi], [0, 1, 0]]. With R the rotation by phi and
    v = R' (dx/dt - w, dy/dt) the velocity through the air, the force is -(R (beta v |v|), 0). The
    disturbance w (..., 1) is wind along x [m/s]; None is still air, which brakes too. Source:
    Richards, Azizan, Slotine and Pavone, Adaptive-control-oriented meta-learning for nonlinear
    systems, RSS 2021, arXiv 2103.04490. `rest` is a hover at 0, which takes u = (g, 0, 0) to hold.
    """

    n_joints = 3
    Parameters = QuadrotorParameters
    fields = _FIELDS
    disturbances = (Channel("wind", "m/s"),)

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Thrust and side force over mass, moment over inertia."""
        names = (("thrust", "m/s^2"), ("moment", "rad/s^2"), ("side_thrust", "m/s^2"))
        return tuple(Channel(*name) for name in names)

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """Position and pitch."""
        return Channel("x", "m"), Channel("y", "m"), Channel("pitch", "rad")

    def mass_matrix(self, q: Tensor, coefficients: QuadrotorParameters) -> Tensor:
        """The identity (..., 3, 3)."""
        return torch.diag_embed(torch.ones_like(q))

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: QuadrotorParameters) -> Tensor:
        """0 (..., 3, 3)."""
        return torch.diag_embed(torch.zeros_like(q))

    def load(self, q: Tensor, qd: Tensor, coefficients: QuadrotorParameters) -> Tensor:
        """Gravity (0, g, 0) (..., 3) [m/s^2]; the air's force depends on the wind."""
        up = torch.zeros_like(q[..., 0]) + coefficients.gravity[..., 0]
        return torch.stack([torch.zeros_like(up), up, torch.zeros_like(up)], dim=-1)

    def input_matrix(self, q: Tensor, coefficients: QuadrotorParameters) -> Tensor:
        """B(q) (..., 3, 3) [-]."""
        cos, sin = torch.cos(q[..., 2]), torch.sin(q[..., 2])
        zero, one = torch.zeros_like(cos), torch.ones_like(cos)
        rows = [-sin, zero, cos, cos, zero, sin, zero, one, zero]
        flat = torch.stack(rows, dim=-1)
        return flat.reshape(*flat.shape[:-1], 3, 3)

    def disturbing_force(
        self,
        t: Tensor,
        state: PlantState,
        disturbance: Tensor | None,
        coefficients: QuadrotorParameters,
    ) -> Tensor:
        """Of the air (..., 3) [m/s^2]."""
        phi = state.q[..., 2]
        cos, sin = torch.cos(phi), torch.sin(phi)
        along, up = state.qd[..., 0], state.qd[..., 1]
        if disturbance is not None:
            along = along - disturbance[..., 0]
        v_1, v_2 = cos * along + sin * up, cos * up - sin * along
        beta_1, beta_2 = coefficients.drag.unbind(-1)
        f_1, f_2 = beta_1 * v_1 * v_1.abs(), beta_2 * v_2 * v_2.abs()
        force = [sin * f_2 - cos * f_1, -(sin * f_1 + cos * f_2), torch.zeros_like(f_1)]
        return torch.stack(force, dim=-1)

    def energy(self, state: PlantState, coefficients: QuadrotorParameters) -> Tensor:
        """Over mass, (...,) [J/kg]."""
        height = coefficients.gravity[..., 0] * state.q[..., 1]
        return self.kinetic_energy(state, coefficients) + height

    def points(self, q: Tensor, parameters: QuadrotorParameters) -> Tensor:
        """The centre of mass (..., 1, 2) [m]."""
        return q[..., None, :2]
