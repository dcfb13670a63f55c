"""A plant that the library does not have, written as a user would: a planar arm of n links."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from mann_torch.plants import MechanicalPlant
from mann_torch.types import PlantState


class NLinkParameters(NamedTuple):
    """Point masses at the links' ends."""

    masses: Tensor  # (..., n) [kg]
    lengths: Tensor  # (..., n) [m]


class NLinkCoefficients(NamedTuple):
    """What the equations of motion need, link by link counted from the base."""

    inertia: Tensor  # (..., n, n) l_i l_j times the mass beyond both links [kg m^2]
    weight: Tensor  # (..., n) g l_i times the mass beyond link i [N m]


class NLinkArm(MechanicalPlant):
    """n links in a vertical plane; joint i turns link i against link i - 1.

    In the links' absolute angles theta = L q, with M_ij = I_ij cos(theta_i - theta_j), everything
    has a closed form: C_ij = I_ij sin(theta_i - theta_j) dtheta_j/dt and N_i = w_i cos theta_i.
    Joint coordinates are L' M L, L' C L and L' N.
    """

    def __init__(self, n_joints: int, gravity: float = 9.8) -> None:
        super().__init__()
        self.n_joints, self.gravity = n_joints, gravity
        self.sums: Tensor  # L
        ones = torch.ones(n_joints, n_joints, dtype=torch.float64)
        self.register_buffer("sums", ones.tril())

    def coefficients(self, parameters: NLinkParameters) -> NLinkCoefficients:
        """From masses and lengths (..., n)."""
        masses, lengths = parameters
        beyond = masses.flip(-1).cumsum(-1).flip(-1)
        both = torch.minimum(beyond.unsqueeze(-1), beyond.unsqueeze(-2))
        inertia = both * lengths.unsqueeze(-1) * lengths.unsqueeze(-2)
        return NLinkCoefficients(inertia, self.gravity * beyond * lengths)

    def mass_matrix(self, q: Tensor, coefficients: NLinkCoefficients) -> Tensor:
        """M(q) (..., n, n) [kg m^2]."""
        absolute = coefficients.inertia * torch.cos(self._between(q))
        return self.sums.mT @ absolute @ self.sums

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: NLinkCoefficients) -> Tensor:
        """C(q, qd) (..., n, n) [N m s/rad]."""
        rate = qd.cumsum(-1).unsqueeze(-2)
        absolute = coefficients.inertia * torch.sin(self._between(q)) * rate
        return self.sums.mT @ absolute @ self.sums

    def load(self, q: Tensor, qd: Tensor, coefficients: NLinkCoefficients) -> Tensor:
        """Gravity (..., n) [N m]."""
        return (coefficients.weight * torch.cos(q.cumsum(-1))) @ self.sums

    def energy(self, state: PlantState, coefficients: NLinkCoefficients) -> Tensor:
        """Kinetic plus potential energy (...,) [J]."""
        qd = state.qd.unsqueeze(-1)
        kinetic = 0.5 * (qd.mT @ self.mass_matrix(state.q, coefficients) @ qd)[..., 0, 0]
        return kinetic + (coefficients.weight * torch.sin(state.q.cumsum(-1))).sum(-1)

    @staticmethod
    def _between(q: Tensor) -> Tensor:
        """theta_i - theta_j (..., n, n) [rad]."""
        theta = q.cumsum(-1)
        return theta.unsqueeze(-1) - theta.unsqueeze(-2)
