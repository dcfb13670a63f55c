"""Links that motors drive through springs."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import choice, whole
from ..domains import NonNegative, Positive
from ..types import Channel, PlantState
from .mechanical import MechanicalPlant
from .n_link_arm import NLinkArm, NLinkCoefficients, NLinkParameters, chain, link_fields
from .plant import Field, channels


class FlexibleJointParameters(NamedTuple):
    """Those of the links, then those of springs and motors, a number a joint."""

    masses: Tensor  # (..., n) [kg]
    lengths: Tensor  # (..., n) [m]
    centers: Tensor  # (..., n) distance of a centre of mass from its joint, of the length [-]
    inertias: Tensor  # (..., n) about the centre of mass [kg m^2]
    viscous: Tensor  # (..., n) [N m s/rad]
    coulomb: Tensor  # (..., n) [N m]
    stiffness: Tensor  # (..., n) K [N m/rad]
    motor_inertia: Tensor  # (..., n) J [kg m^2]
    motor_friction: Tensor  # (..., n) B_m [N m s/rad]


class FlexibleJointCoefficients(NamedTuple):
    """What the equations need of links, springs and motors."""

    links: NLinkCoefficients
    stiffness: Tensor  # (..., n) [N m/rad]
    motor_inertia: Tensor  # (..., n) [kg m^2]
    motor_friction: Tensor  # (..., n) [N m s/rad]


class FlexibleJointArm(MechanicalPlant):
    """An arm of n links with flexible joints; coordinates are the n links', then the n motors'.

    M(q_l) qdd_l + C(q_l, qd_l) qd_l + N(q_l, qd_l) = K (q_m - q_l),
    J qdd_m + B_m qd_m + K (q_m - q_l) = tau. Source: Spong 1987, Modeling and control of elastic
    joint robots, with the links of `NLinkArm`.

    The links' angles are to follow the reference. `measured` says what a controller sees: "motors",
    as most encoders sit there, "links" or "all". `gravity` [m/s^2] and `coulomb_velocity` [rad/s]
    are the links'. Raises `ConfigError`, `DomainError` or `KindError`.
    """

    Parameters = FlexibleJointParameters

    def __init__(
        self,
        n_links: int = 2,
        gravity: float = 9.8,
        coulomb_velocity: float = 0.01,
        measured: str = "motors",
    ) -> None:
        super().__init__()
        n = self.n_links = whole("n_links", n_links)
        self.n_joints = 2 * n
        self.links = NLinkArm(n, gravity, coulomb_velocity)
        self.fields = {
            **link_fields(n),
            "stiffness": Field((100.0,) * n, Positive(), "N m/rad"),
            "motor_inertia": Field((1.0,) * n, Positive(), "kg m^2"),
            "motor_friction": Field((0.0,) * n, NonNegative(), "N m s/rad"),
        }
        seen = {"motors": tuple(range(n, 2 * n)), "links": tuple(range(n)), "all": None}
        self.sensing = seen[choice("measured", measured, seen)]

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """A torque a motor."""
        return channels("torque", self.n_links, "N m")

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The links' angles."""
        return channels("q", self.n_links, "rad")

    def output(self, state: PlantState, coefficients: FlexibleJointCoefficients) -> Tensor:
        """The links' angles (..., n) [rad]."""
        return state.q[..., : self.n_links]

    def check(self, parameters: FlexibleJointParameters) -> None:
        """As the links'."""
        super().check(parameters)
        self.links.check(NLinkParameters(*parameters[:6]))

    def coefficients(self, parameters: FlexibleJointParameters) -> FlexibleJointCoefficients:
        """From rows (..., n)."""
        links = self.links.coefficients(NLinkParameters(*parameters[:6]))
        return FlexibleJointCoefficients(links, *parameters[6:])

    def mass_matrix(self, q: Tensor, coefficients: FlexibleJointCoefficients) -> Tensor:
        """diag(M, J) (..., 2n, 2n) [kg m^2]."""
        links = self.links.mass_matrix(q[..., : self.n_links], coefficients.links)
        motors = torch.diag_embed(coefficients.motor_inertia)
        zero = torch.zeros_like(links)
        return _blocks(links, zero, zero, motors)

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: FlexibleJointCoefficients) -> Tensor:
        """diag(C, 0) (..., 2n, 2n) [N m s/rad]."""
        n = self.n_links
        links = self.links.coriolis(q[..., :n], qd[..., :n], coefficients.links)
        zero = torch.zeros_like(links)
        return _blocks(links, zero, zero, zero)

    def load(self, q: Tensor, qd: Tensor, coefficients: FlexibleJointCoefficients) -> Tensor:
        """Gravity, friction and springs (..., 2n) [N m]."""
        n = self.n_links
        links = self.links.load(q[..., :n], qd[..., :n], coefficients.links)
        motors = coefficients.motor_friction * qd[..., n:]
        springs = coefficients.stiffness * self._stretch(q)
        return _row(links + springs, motors - springs)

    def input_matrix(self, q: Tensor, coefficients: FlexibleJointCoefficients) -> Tensor:
        """Torques act on the motors: (2n, n)."""
        return torch.eye(2 * self.n_links, dtype=q.dtype, device=q.device)[:, self.n_links :]

    def load_slope(self, q: Tensor, qd: Tensor, coefficients: FlexibleJointCoefficients) -> Tensor:
        """Slope of the friction (..., 2n) [N m s/rad]."""
        n = self.n_links
        links = self.links.load_slope(q[..., :n], qd[..., :n], coefficients.links)
        motors = coefficients.motor_friction
        return _row(torch.zeros_like(motors) if links is None else links, motors)

    def load_stiffness(
        self, q: Tensor, qd: Tensor, coefficients: FlexibleJointCoefficients
    ) -> Tensor:
        """The springs (..., 2n, 2n) [N m/rad]; gravity is not stiff."""
        springs = torch.diag_embed(coefficients.stiffness)
        return _blocks(springs, -springs, -springs, springs)

    def energy(self, state: PlantState, coefficients: FlexibleJointCoefficients) -> Tensor:
        """Of links, springs and motors (...,) [J]."""
        n = self.n_links
        q, qd = state
        links = self.links.energy(PlantState(q[..., :n], qd[..., :n]), coefficients.links)
        motors = coefficients.motor_inertia * qd[..., n:].square()
        springs = coefficients.stiffness * self._stretch(q).square()
        return links + 0.5 * (motors + springs).sum(-1)

    def points(self, q: Tensor, parameters: FlexibleJointParameters) -> Tensor:
        """The links' base and ends (..., n + 1, 2) [m]."""
        return chain(q[..., : self.n_links], parameters.lengths)

    def _stretch(self, q: Tensor) -> Tensor:
        """q_l - q_m (..., n) [rad]."""
        return q[..., : self.n_links] - q[..., self.n_links :]


def _row(a: Tensor, b: Tensor) -> Tensor:
    """(a, b) (..., 2n) of rows (..., n)."""
    return torch.cat(torch.broadcast_tensors(a, b), dim=-1)


def _blocks(a: Tensor, b: Tensor, c: Tensor, d: Tensor) -> Tensor:
    """[[a, b], [c, d]] (..., 2n, 2n) of blocks (..., n, n)."""
    a, b, c, d = torch.broadcast_tensors(a, b, c, d)
    return torch.cat([torch.cat([a, b], dim=-1), torch.cat([c, d], dim=-1)], dim=-2)
