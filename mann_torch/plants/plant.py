"""The plant interface: M(q) qdd + C(q, qd) qd + N(q, qd) = tau."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import torch
from torch import Tensor, nn

from ..functional import solve_small, times_column
from ..types import Linearization, Measurement, PlantState, TorqueGains

# NamedTuples of tensors, each plant defines its own. Parameters (..., n) are what a user gives and
# a schedule moves; Coefficients are what the equations of motion need, made from them once.
Parameters = Any
Coefficients = Any


class Plant(nn.Module):
    """Interface of every plant: a mechanical system with n torque inputs."""

    n_joints: int

    @abstractmethod
    def coefficients(self, parameters: Parameters) -> Coefficients:
        """What the equations below need, computed once while the parameters are constant."""

    @abstractmethod
    def mass_matrix(self, q: Tensor, coefficients: Coefficients) -> Tensor:
        """M(q) (..., n, n), symmetric positive definite [kg m^2]."""

    @abstractmethod
    def coriolis(self, q: Tensor, qd: Tensor, coefficients: Coefficients) -> Tensor:
        """C(q, qd) (..., n, n) with dM/dt - 2 C skew-symmetric [N m s/rad]."""

    @abstractmethod
    def load(self, q: Tensor, qd: Tensor, coefficients: Coefficients) -> Tensor:
        """N(q, qd) (..., n): gravity and friction [N m]."""

    @abstractmethod
    def energy(self, state: PlantState, coefficients: Coefficients) -> Tensor:
        """Kinetic plus potential energy (...,) [J]."""

    def load_slope(self, q: Tensor, qd: Tensor, coefficients: Coefficients) -> Tensor | None:
        """dN_j/d(qd_j) (..., n) where friction is stiff [N m s/rad], None where there is none.

        The implicit solver treats it implicitly; it may be approximate.
        """
        return None

    def check(self, parameters: Parameters) -> None:
        """Raise a `ConfigError` for parameters (or rows of a schedule) out of range."""
        return None

    def measure(self, state: PlantState) -> Measurement:
        """What a controller sees of the state."""
        return Measurement(state.q, state.qd)

    def derivative(
        self,
        state: PlantState,
        torque: Tensor,
        coefficients: Coefficients,
        gains: TorqueGains | None = None,
    ) -> tuple[PlantState, Linearization | None]:
        """Time derivative of the state under a torque (..., n) [N m].

        With the controller's `gains`, also the stiff block M^-1 gains, from the same solve.
        """
        q, qd = state
        force = (
            torque
            - times_column(self.coriolis(q, qd, coefficients), qd)
            - self.load(q, qd, coefficients)
        )
        columns = [force.unsqueeze(-1)]
        if gains is not None:
            slope = self.load_slope(q, qd, coefficients)
            rate = gains.rate if slope is None else gains.rate + torch.diag_embed(slope)
            columns += [gains.position, rate, gains.drift.unsqueeze(-1)]
        solved = solve_small(self.mass_matrix(q, coefficients), torch.cat(columns, dim=-1))
        derivative = PlantState(qd, solved[..., 0])
        if gains is None:
            return derivative, None
        n = qd.shape[-1]
        stiffness, damping = solved[..., 1 : n + 1], solved[..., n + 1 : 2 * n + 1]
        return derivative, Linearization(stiffness, damping, solved[..., -1])
