"""A planar arm of n links, in closed form."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, POSITIVE, number, whole
from ..domains import Finite, NonNegative, Positive
from ..errors import DomainError
from ..functional import row_times
from ..types import PlantState
from .friction import friction_slope, unless_zero, with_friction
from .mechanical import MechanicalPlant
from .plant import Field


class NLinkParameters(NamedTuple):
    """Physical parameters of an arm of n links, counted from the base."""

    masses: Tensor  # (..., n) [kg]
    lengths: Tensor  # (..., n) [m]
    centers: Tensor  # (..., n) distance of a centre of mass from its joint, of the length [-]
    inertias: Tensor  # (..., n) about the centre of mass [kg m^2]
    viscous: Tensor  # (..., n) [N m s/rad]
    coulomb: Tensor  # (..., n) [N m]


class NLinkCoefficients(NamedTuple):
    """What the equations of motion need, in the links' absolute angles."""

    coupling: Tensor  # (..., n, n) without the links' own inertia [kg m^2]
    inertias: Tensor  # (..., n) [kg m^2]
    weight: Tensor  # (..., n) moment of gravity on a level link [N m]
    viscous: Tensor | None  # (..., n); None without friction
    coulomb: Tensor | None  # (..., n)


def link_fields(n: int) -> dict[str, Field]:
    """Fields of n links: point masses of 1 kg at the ends of links of 1 m."""
    ones, zeros = (1.0,) * n, (0.0,) * n
    return {
        "masses": Field(ones, Positive(), "kg"),
        "lengths": Field(ones, Positive(), "m"),
        "centers": Field(ones, Finite(), "-"),
        "inertias": Field(zeros, NonNegative(), "kg m^2"),
        "viscous": Field(zeros, NonNegative(), "N m s/rad"),
        "coulomb": Field(zeros, NonNegative(), "N m"),
    }


class NLinkArm(MechanicalPlant):
    """n links in a vertical plane; joint i turns link i against link i - 1.

    In the absolute angles theta = L q, L the matrix of sums, the centre of link k moves by a_ki
    with angle i: l_i where i < k, its own distance where i = k. With I_ij = sum_k m_k a_ki a_kj,
    w_i = g sum_k m_k a_ki and the links' inertias J,
    M = I_ij cos(theta_i - theta_j) + diag(J), C = I_ij sin(theta_i - theta_j) dtheta_j/dt and
    N = w_i cos(theta_i); joint coordinates have L' M L, L' C L and L' N. Source: Lagrange's
    equations; two links with masses at their ends are the paper's arm.

    `gravity` g [m/s^2]; Coulomb friction is coulomb tanh(qd / `coulomb_velocity`) [rad/s]. Raises
    `ConfigError`, `DomainError` or `KindError`.
    """

    Parameters = NLinkParameters

    def __init__(
        self, n_joints: int = 3, gravity: float = 9.8, coulomb_velocity: float = 0.01
    ) -> None:
        super().__init__()
        self.n_joints = whole("n_joints", n_joints)
        number("gravity", gravity, NONNEGATIVE, DomainError)
        number("coulomb_velocity", coulomb_velocity, POSITIVE, DomainError)
        # As they came: a tensor keeps its gradient.
        self.gravity, self.coulomb_velocity = gravity, coulomb_velocity
        self.fields = link_fields(self.n_joints)

    def check(self, parameters: NLinkParameters) -> None:
        """As every plant's; `DomainError` too for a last link that nothing gives inertia."""
        super().check(parameters)
        centers, inertias = parameters.centers, parameters.inertias
        none = (centers[..., -1] == 0) & (inertias[..., -1] == 0)
        if not none.is_meta and bool(none.any()):
            raise DomainError(
                "centers and inertias are both 0 for the last link: it has no inertia about its "
                "joint, and no motion follows from a torque; give one of them"
            )

    def coefficients(self, parameters: NLinkParameters) -> NLinkCoefficients:
        """From rows (..., n)."""
        masses, lengths, centers, inertias, viscous, coulomb = parameters
        inner = torch.ones(self.n_joints, self.n_joints, dtype=lengths.dtype, device=lengths.device)
        arms = lengths.unsqueeze(-2) * inner.tril(-1) + torch.diag_embed(centers * lengths)
        coupling = arms.mT @ (masses.unsqueeze(-1) * arms)
        weight = self.gravity * row_times(masses, arms)
        friction = unless_zero(viscous), unless_zero(coulomb)
        return NLinkCoefficients(coupling, inertias, weight, *friction)

    def mass_matrix(self, q: Tensor, coefficients: NLinkCoefficients) -> Tensor:
        """M(q) (..., n, n) [kg m^2]."""
        absolute = coefficients.coupling * torch.cos(self._between(q))
        absolute = absolute + torch.diag_embed(coefficients.inertias)
        return _sums(_sums(absolute, -1), -2)

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: NLinkCoefficients) -> Tensor:
        """C(q, qd) (..., n, n) [N m s/rad]."""
        rate = qd.cumsum(-1).unsqueeze(-2)
        absolute = coefficients.coupling * torch.sin(self._between(q)) * rate
        return _sums(_sums(absolute, -1), -2)

    def load(self, q: Tensor, qd: Tensor, coefficients: NLinkCoefficients) -> Tensor:
        """Gravity plus friction (..., n) [N m]."""
        gravity = _sums(coefficients.weight * torch.cos(q.cumsum(-1)), -1)
        return with_friction(gravity, qd, *coefficients[3:], self.coulomb_velocity)

    def load_slope(self, q: Tensor, qd: Tensor, coefficients: NLinkCoefficients) -> Tensor | None:
        """Slope of the friction (..., n) [N m s/rad]; None without friction."""
        return friction_slope(qd, *coefficients[3:], self.coulomb_velocity)

    def energy(self, state: PlantState, coefficients: NLinkCoefficients) -> Tensor:
        """Kinetic plus potential energy (...,) [J]."""
        potential = (coefficients.weight * torch.sin(state.q.cumsum(-1))).sum(-1)
        return self.kinetic_energy(state, coefficients) + potential

    def points(self, q: Tensor, parameters: NLinkParameters) -> Tensor:
        """The base and the ends of the links (..., n + 1, 2) [m]; q = 0 stretches them along x."""
        return chain(q, parameters.lengths)

    @staticmethod
    def _between(q: Tensor) -> Tensor:
        """theta_i - theta_j (..., n, n) [rad]."""
        theta = q.cumsum(-1)
        return theta.unsqueeze(-1) - theta.unsqueeze(-2)


def chain(q: Tensor, lengths: Tensor) -> Tensor:
    """The base and the ends of links (..., n + 1, 2) [m] at joint angles q (..., n) [rad]."""
    theta = q.cumsum(-1)
    along = torch.stack([torch.cos(theta), torch.sin(theta)], dim=-1)
    ends = (lengths.unsqueeze(-1) * along).cumsum(-2)
    return torch.cat([torch.zeros_like(ends[..., :1, :]), ends], dim=-2)


def _sums(x: Tensor, dim: int) -> Tensor:
    """L' x along a dimension: what a link and all beyond it have together."""
    return x.flip(dim).cumsum(dim).flip(dim)
