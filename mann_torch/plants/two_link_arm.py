"""The paper's planar two-link arm."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, POSITIVE, number
from ..domains import NonNegative, Positive
from ..errors import DomainError
from ..functional import Numbers
from ..types import PlantState
from .friction import friction_slope, unless_zero, with_friction
from .mechanical import MechanicalPlant, two_by_two
from .n_link_arm import chain
from .plant import Field


class ArmParameters(NamedTuple):
    """Physical parameters of the arm, one row per sample (build with `arm_parameters`)."""

    masses: Tensor  # (..., 2) m_1, m_2 [kg]
    lengths: Tensor  # (..., 2) l_1, l_2 [m]
    viscous: Tensor  # (..., 2) [N m s/rad]
    coulomb: Tensor  # (..., 2) [N m]


_FIELDS = {
    "masses": Field((0.8, 2.3), Positive(), "kg"),
    "lengths": Field((1.0, 1.0), Positive(), "m"),
    "viscous": Field((0.0, 0.0), NonNegative(), "N m s/rad"),
    "coulomb": Field((0.0, 0.0), NonNegative(), "N m"),
}


def arm_parameters(
    masses: Numbers = (0.8, 2.3),
    lengths: Numbers = (1.0, 1.0),
    viscous: Numbers = (0.0, 0.0),
    coulomb: Numbers = (0.0, 0.0),
) -> ArmParameters:
    """Checked parameters of the arm, each (..., 2); the defaults are the paper's.

    Raises `ShapeError` where the last dimension is not 2, `DomainError` for masses or lengths
    that are not finite and > 0 or friction that is not finite and >= 0, `KindError` or `DtypeError`
    for what is not made of float64 numbers.
    """
    parameters: ArmParameters = TwoLinkArm().parameters_of(
        masses=masses, lengths=lengths, viscous=viscous, coulomb=coulomb
    )
    return parameters


class ArmCoefficients(NamedTuple):
    """The paper's abbreviations (...,) and the friction (..., 2) where there is any."""

    phi: Tensor  # (m_1 + m_2) l_1^2 [kg m^2]
    rho: Tensor  # m_2 l_2^2 [kg m^2]
    psi: Tensor  # m_2 l_1 l_2 [kg m^2]
    phi_gamma: Tensor  # phi g / l_1 [N m]
    psi_gamma: Tensor  # psi g / l_1 [N m]
    viscous: Tensor | None  # [N m s/rad]; None without friction
    coulomb: Tensor | None  # [N m]


class TwoLinkArm(MechanicalPlant):
    """Two links in a vertical plane. Paper: eqs. (mass), (cor) and the load vector after them.

    `gravity` g [m/s^2]. Coulomb friction is smoothed, coulomb tanh(qd / `coulomb_velocity`)
    [rad/s], so that it has a derivative. Raises `DomainError`, `KindError`.
    """

    n_joints = 2
    Parameters = ArmParameters
    fields = _FIELDS

    def __init__(self, gravity: float = 9.8, coulomb_velocity: float = 0.01) -> None:
        super().__init__()
        number("gravity", gravity, NONNEGATIVE, DomainError)
        number("coulomb_velocity", coulomb_velocity, POSITIVE, DomainError)
        # As they came: a tensor keeps its gradient.
        self.gravity, self.coulomb_velocity = gravity, coulomb_velocity

    def coefficients(self, parameters: ArmParameters) -> ArmCoefficients:
        """phi, rho, psi and gamma = g / l_1 from masses and lengths (..., 2)."""
        m_1, m_2 = parameters.masses.unbind(-1)
        l_1, l_2 = parameters.lengths.unbind(-1)
        phi, rho, psi = (m_1 + m_2) * l_1 * l_1, m_2 * l_2 * l_2, m_2 * l_1 * l_2
        gamma = self.gravity / l_1
        friction = unless_zero(parameters.viscous), unless_zero(parameters.coulomb)
        return ArmCoefficients(phi, rho, psi, phi * gamma, psi * gamma, *friction)

    def mass_matrix(self, q: Tensor, coefficients: ArmCoefficients) -> Tensor:
        """M(q) (..., 2, 2) [kg m^2]."""
        phi, rho, psi = coefficients[:3]
        coupling = psi * torch.cos(q[..., 1])
        off = rho + coupling
        return two_by_two(phi + off + coupling, off, off, rho)

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: ArmCoefficients) -> Tensor:
        """V_m(q, qd) (..., 2, 2) [N m s/rad]."""
        h = coefficients.psi * torch.sin(q[..., 1])
        qd_1, qd_2 = qd.unbind(-1)
        first = h * qd_1
        return two_by_two(-h * qd_2, -h * (qd_1 + qd_2), first, torch.zeros_like(first))

    def load(self, q: Tensor, qd: Tensor, coefficients: ArmCoefficients) -> Tensor:
        """Gravity plus friction (..., 2) [N m]."""
        q_1, q_2 = q.unbind(-1)
        outer_link = coefficients.psi_gamma * torch.cos(q_1 + q_2)
        inner_link = coefficients.phi_gamma * torch.cos(q_1)
        load = torch.stack([inner_link + outer_link, outer_link], dim=-1)
        return with_friction(load, qd, *coefficients[5:], self.coulomb_velocity)

    def load_slope(self, q: Tensor, qd: Tensor, coefficients: ArmCoefficients) -> Tensor | None:
        """Slope of the friction (..., 2) [N m s/rad]; None without friction."""
        return friction_slope(qd, *coefficients[5:], self.coulomb_velocity)

    def energy(self, state: PlantState, coefficients: ArmCoefficients) -> Tensor:
        """Kinetic plus potential energy (...,) [J]."""
        q_1, q_2 = state.q.unbind(-1)
        potential = coefficients.phi_gamma * torch.sin(q_1)
        kinetic = self.kinetic_energy(state, coefficients)
        return kinetic + potential + coefficients.psi_gamma * torch.sin(q_1 + q_2)

    def points(self, q: Tensor, parameters: ArmParameters) -> Tensor:
        """The base and the ends of the links (..., 3, 2) [m]; q = 0 stretches them along x."""
        return chain(q, parameters.lengths)
