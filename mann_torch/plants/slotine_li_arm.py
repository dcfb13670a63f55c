"""Slotine and Li's two-link arm, linear in four unknown parameters."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, number
from ..domains import Domain
from ..errors import DomainError
from ..types import PlantState
from .mechanical import MechanicalPlant, two_by_two
from .plant import Field


class SlotineLiParameters(NamedTuple):
    """The arm's four lumped parameters."""

    a: Tensor  # (..., 4) a_1 ... a_4 [kg m^2]


class PositiveArm(Domain):
    """Rows a_1 ... a_4 whose M(q) is positive definite for every q."""

    text = "finite with a_2 > 0 and (a_1 - a_2) a_2 > a_3^2 + a_4^2, so that M(q) is positive"

    def contains(self, value: Tensor) -> bool:
        a_1, a_2, a_3, a_4 = value.unbind(-1)
        # det M = (a_1 - a_2) a_2 - (a_3 c_2 + a_4 s_2)^2
        definite = (a_1 - a_2) * a_2 > a_3.square() + a_4.square()
        return bool((definite & (a_2 > 0)).all())


def lumped(
    mass: float = 1.0,
    length: float = 1.0,
    center: float = 0.5,
    inertia: float = 0.12,
    load_mass: float = 2.0,
    load_center: float = 0.6,
    load_inertia: float = 0.25,
    load_angle: float = math.pi / 6,
) -> tuple[float, float, float, float]:
    """a_1 ... a_4 [kg m^2] of a link (m_1, l_1, l_c1, I_1) and of an outer one with its load.

    The latter's m_e, l_ce, I_e and delta: [kg], [m], [kg m^2], [rad]. Raises `KindError`, or
    `DomainError` for masses, lengths or inertias below 0.
    """
    sizes = {
        "mass": mass,
        "length": length,
        "center": center,
        "inertia": inertia,
        "load_mass": load_mass,
        "load_center": load_center,
        "load_inertia": load_inertia,
    }
    m, l_1, c, own, m_e, c_e, own_e = (
        number(name, value, NONNEGATIVE, DomainError) for name, value in sizes.items()
    )
    delta = number("load_angle", load_angle)
    outer, reach = own_e + m_e * c_e**2, m_e * l_1 * c_e
    first = own + m * c**2 + outer + m_e * l_1**2
    return first, outer, reach * math.cos(delta), reach * math.sin(delta)


_FIELDS = {"a": Field(lumped(), PositiveArm(), "kg m^2")}


class SlotineLiArm(MechanicalPlant):
    """Two links in a horizontal plane, the outer with an unknown load.

    M_11 = a_1 + 2 a_3 c_2 + 2 a_4 s_2, M_12 = a_2 + a_3 c_2 + a_4 s_2, M_22 = a_2;
    h = a_3 s_2 - a_4 c_2, C = [[-h qd_2, -h (qd_1 + qd_2)], [h qd_1, 0]]; no gravity, no friction.
    Source: Slotine and Li 1987, On the adaptive control of robot manipulators, and their book,
    example 9.3.
    """

    n_joints = 2
    Parameters = SlotineLiParameters
    fields = _FIELDS

    def mass_matrix(self, q: Tensor, coefficients: SlotineLiParameters) -> Tensor:
        """M(q) (..., 2, 2) [kg m^2]."""
        a_1, a_2, a_3, a_4 = coefficients.a.unbind(-1)
        coupling = a_3 * torch.cos(q[..., 1]) + a_4 * torch.sin(q[..., 1])
        off = a_2 + coupling
        return two_by_two(a_1 + 2.0 * coupling, off, off, a_2)

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: SlotineLiParameters) -> Tensor:
        """C(q, qd) (..., 2, 2) [N m s/rad]."""
        _, _, a_3, a_4 = coefficients.a.unbind(-1)
        h = a_3 * torch.sin(q[..., 1]) - a_4 * torch.cos(q[..., 1])
        qd_1, qd_2 = qd.unbind(-1)
        first = h * qd_1
        return two_by_two(-h * qd_2, -h * (qd_1 + qd_2), first, torch.zeros_like(first))

    def load(self, q: Tensor, qd: Tensor, coefficients: SlotineLiParameters) -> Tensor:
        """Nothing (..., 2) [N m]."""
        return torch.zeros_like(q)

    def energy(self, state: PlantState, coefficients: SlotineLiParameters) -> Tensor:
        """Kinetic energy (...,) [J]."""
        return self.kinetic_energy(state, coefficients)

    def regressor(self, q: Tensor, qd: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """Y (..., 2, 4) with Y (a_1 ... a_4) = M(q) a + C(q, qd) v; a [rad/s^2], v [rad/s]."""
        cos, sin = torch.cos(q[..., 1]), torch.sin(q[..., 1])
        (qd_1, qd_2), (v_1, v_2), (a_1, a_2) = qd.unbind(-1), v.unbind(-1), a.unbind(-1)
        both, wide = a_1 + a_2, 2.0 * a_1 + a_2
        g = qd_2 * v_1 + qd_1 * v_2 + qd_2 * v_2
        push = qd_1 * v_1
        zero = torch.zeros_like(both)
        first = torch.stack([a_1, a_2, wide * cos - g * sin, wide * sin + g * cos], dim=-1)
        second = torch.stack([zero, both, a_1 * cos + push * sin, a_1 * sin - push * cos], dim=-1)
        return torch.stack([first, second], dim=-2)
