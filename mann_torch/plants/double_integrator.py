"""Masses that forces push: the simplest mechanical plant."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import whole
from ..domains import Positive
from ..types import Channel, PlantState
from .mechanical import MechanicalPlant
from .plant import Field, channels


class DoubleIntegratorParameters(NamedTuple):
    """A mass a coordinate."""

    masses: Tensor  # (..., n) [kg]


class DoubleIntegrator(MechanicalPlant):
    """m_i d2q_i/dt2 = u_i for n coordinates [m]; with masses of 1 kg, the double integrator.

    Source: Newton's second law. Raises `ConfigError` or `KindError`.
    """

    Parameters = DoubleIntegratorParameters

    def __init__(self, n_joints: int = 1) -> None:
        super().__init__()
        self.n_joints = whole("n_joints", n_joints)
        self.fields = {"masses": Field((1.0,) * self.n_joints, Positive(), "kg")}

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """A force a coordinate."""
        return channels("force", self.n_joints, "N")

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The positions."""
        return channels("q", self.n_joints, "m")

    def mass_matrix(self, q: Tensor, coefficients: DoubleIntegratorParameters) -> Tensor:
        """diag(m) (..., n, n) [kg]."""
        return torch.diag_embed(torch.zeros_like(q) + coefficients.masses)

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: DoubleIntegratorParameters) -> Tensor:
        """0 (..., n, n)."""
        return torch.diag_embed(torch.zeros_like(q))

    def load(self, q: Tensor, qd: Tensor, coefficients: DoubleIntegratorParameters) -> Tensor:
        """0 (..., n)."""
        return torch.zeros_like(q)

    def energy(self, state: PlantState, coefficients: DoubleIntegratorParameters) -> Tensor:
        """Kinetic energy (...,) [J]."""
        return self.kinetic_energy(state, coefficients)
