"""Mechanical plants: M(q) qdd + C(q, qd) qd + N(q, qd) = B(q) tau."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from ..functional import solve_small, times_column
from ..stiff import SecondOrderBlock
from ..types import Channel, InputGains, Measurement, PlantState
from .plant import Coefficients, Parameters, Plant, channels, zeros


class Torque(NamedTuple):
    """Inputs of a mechanical plant."""

    torque: Tensor  # (..., m) [N m]


class MechanicalPlant(Plant):
    """The family of mechanical systems with n coordinates, of which a plant gives M, C and N.

    On top of `Plant`'s contract:

    1. M is symmetric positive definite, dM/dt - 2 C skew-symmetric, C qd as Lagrange's equations
       have it.
    2. `energy` is what an undisturbed plant without inputs and friction keeps.
    3. Where fewer or other inputs than one a coordinate drive it, `input_matrix` is B (..., n, m),
       and `inputs` names them.
    4. What is measured are positions and velocities: of all coordinates, or of those that `sensing`
       names, and the output is a part of q, unless `output` says otherwise.
    5. Where there is a `regressor`, one theta gives M a + C v + N from it everywhere.
    """

    Input: ClassVar[type] = Torque
    n_joints: int
    #: Which coordinates are measured, counted from 0; None: all are.
    sensing: tuple[int, ...] | None = None

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """A torque a joint."""
        return channels("torque", self.n_joints, "N m")

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The joints' angles."""
        return channels("q", self.n_joints, "rad")

    @abstractmethod
    def mass_matrix(self, q: Tensor, coefficients: Coefficients) -> Tensor:
        """M(q) (..., n, n), symmetric positive definite [kg m^2]."""

    @abstractmethod
    def coriolis(self, q: Tensor, qd: Tensor, coefficients: Coefficients) -> Tensor:
        """C(q, qd) (..., n, n) with dM/dt - 2 C skew-symmetric [N m s/rad]."""

    @abstractmethod
    def load(self, q: Tensor, qd: Tensor, coefficients: Coefficients) -> Tensor:
        """N(q, qd) (..., n): gravity, springs and friction [N m]."""

    @abstractmethod
    def energy(self, state: PlantState, coefficients: Coefficients) -> Tensor:
        """Kinetic plus potential energy (...,) [J]."""

    def kinetic_energy(self, state: PlantState, coefficients: Coefficients) -> Tensor:
        """qd' M(q) qd / 2 (...,) [J]."""
        qd = state.qd.unsqueeze(-1)
        return 0.5 * (qd.mT @ self.mass_matrix(state.q, coefficients) @ qd)[..., 0, 0]

    def load_slope(self, q: Tensor, qd: Tensor, coefficients: Coefficients) -> Tensor | None:
        """dN_j/d(qd_j) (..., n) where friction is stiff [N m s/rad], None where there is none.

        The implicit solver treats it implicitly; it may be approximate.
        """
        return None

    def load_stiffness(self, q: Tensor, qd: Tensor, coefficients: Coefficients) -> Tensor | None:
        """dN/dq (..., n, n) where springs are stiff [N m/rad], None where there are none."""
        return None

    def input_matrix(self, q: Tensor, coefficients: Coefficients) -> Tensor | None:
        """B(q) (..., n, m); None is the identity."""
        return None

    def disturbing_force(
        self, t: Tensor, state: PlantState, disturbance: Tensor | None, coefficients: Coefficients
    ) -> Tensor | None:
        """What `disturbances` (..., k) do, (..., n) [N m]; None: nothing."""
        return None

    def regressor(self, q: Tensor, qd: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """Y (..., n, k) with Y theta = M(q) a + C(q, qd) v + N(q, qd), of a plant that has one.

        Raises `NotImplementedError` where there is none.
        """
        raise NotImplementedError(f"{type(self).__name__} has no regressor")

    def points(self, q: Tensor, parameters: Parameters) -> Tensor:
        """Where the mechanism's points are in its plane, (..., k, 2) [m], of one that has a shape.

        Raises `NotImplementedError` where there is none.
        """
        raise NotImplementedError(f"{type(self).__name__} has no shape")

    def rest(self) -> PlantState:
        """At rest at q = 0."""
        return PlantState(*zeros(self.n_joints, self.n_joints))

    def output(self, state: PlantState, coefficients: Coefficients) -> Tensor:
        """q (..., n) [rad]."""
        return state.q

    def measure(self, state: PlantState, coefficients: Coefficients) -> Measurement:
        """Positions and velocities, of the coordinates that are measured."""
        if self.sensing is None:
            return Measurement(state.q, state.qd)
        seen = self.sensing
        return Measurement(*(torch.stack([x[..., i] for i in seen], dim=-1) for x in state))

    def derivative(
        self,
        t: Tensor,
        state: PlantState,
        input: Torque,
        disturbance: Tensor | None,
        coefficients: Coefficients,
    ) -> PlantState:
        """(qd, qdd) of the equation of motion."""
        q, qd = state
        force = self._force(t, state, input, disturbance, coefficients).unsqueeze(-1)
        return PlantState(qd, solve_small(self.mass_matrix(q, coefficients), force)[..., 0])

    def linearized(
        self,
        t: Tensor,
        state: PlantState,
        input: Torque,
        disturbance: Tensor | None,
        coefficients: Coefficients,
        gains: InputGains | None,
    ) -> tuple[PlantState, SecondOrderBlock | None]:
        """The derivative and the stiff block M^-1 [B gains + dN], from the same solve."""
        q, qd = state
        n = qd.shape[-1]
        slope = self.load_slope(q, qd, coefficients)
        springs = self.load_stiffness(q, qd, coefficients)
        if gains is None and slope is None and springs is None:
            return self.derivative(t, state, input, disturbance, coefficients), None
        force = self._force(t, state, input, disturbance, coefficients)
        if gains is None:
            zero = torch.zeros_like(qd)
            wide, drift = torch.zeros_like(torch.cat([qd, qd], dim=-1)), zero
            block = wide.unsqueeze(-2).expand(*zero.shape, 2 * n)
        else:
            block, drift = self._through(gains, q, coefficients)
        blocks = [block]
        if slope is not None or springs is not None:
            position, rate = block[..., :n], block[..., n:]
            blocks = [
                position if springs is None else position + springs,
                rate if slope is None else rate + torch.diag_embed(slope),
            ]
        columns = [force.unsqueeze(-1), *blocks, drift.unsqueeze(-1)]
        solved = solve_small(self.mass_matrix(q, coefficients), torch.cat(columns, dim=-1))
        stiffness, damping = solved[..., 1 : n + 1], solved[..., n + 1 : 2 * n + 1]
        return PlantState(qd, solved[..., 0]), SecondOrderBlock(stiffness, damping, solved[..., -1])

    def _through(
        self, gains: InputGains, q: Tensor, coefficients: Coefficients
    ) -> tuple[Tensor, Tensor]:
        """Gains on all coordinates (..., n, 2n) and drift (..., n), as forces."""
        block, drift = gains
        if self.sensing is not None:
            seen, n = self.sensing, q.shape[-1]
            unseen = torch.zeros_like(block[..., 0])
            places = [seen.index(j) if j in seen else None for j in range(n)]
            halves = block[..., : len(seen)], block[..., len(seen) :]
            columns = [unseen if i is None else half[..., i] for half in halves for i in places]
            block = torch.stack(columns, dim=-1)
        B = self.input_matrix(q, coefficients)
        if B is None:
            return block, drift
        return B @ block, times_column(B, drift)

    def _force(
        self,
        t: Tensor,
        state: PlantState,
        input: Torque,
        disturbance: Tensor | None,
        coefficients: Coefficients,
    ) -> Tensor:
        """B tau - C qd - N (..., n) [N m]."""
        q, qd = state
        B = self.input_matrix(q, coefficients)
        torque = input.torque if B is None else times_column(B, input.torque)
        force = (
            torque
            - times_column(self.coriolis(q, qd, coefficients), qd)
            - self.load(q, qd, coefficients)
        )
        other = self.disturbing_force(t, state, disturbance, coefficients)
        return force if other is None else force + other


def two_by_two(a: Tensor, b: Tensor, c: Tensor, d: Tensor) -> Tensor:
    """[[a, b], [c, d]] (..., 2, 2) of entries (...,)."""
    flat = torch.stack(torch.broadcast_tensors(a, b, c, d), dim=-1)
    return flat.reshape(*flat.shape[:-1], 2, 2)
