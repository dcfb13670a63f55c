"""Computed torque: a mechanical plant's equations turned round."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..constraints import PositiveRow
from ..functional import Numbers
from ..trees import portable
from ..types import ControlOutput, InputGains, Measurement, Mode, ReferenceSample
from .boundary_layer import BoundaryLayer
from .controller import Controller
from .integral import IntegralAction
from .mechanics import Mechanics, NominalMechanics
from .tracking import check_joints, check_measured, tracking_gains


@portable
class ErrorIntegral(NamedTuple):
    """Integral of the error."""

    integral: Tensor  # (..., n)


class ComputedTorqueSignals(NamedTuple):
    """What the controller shows."""

    error: Tensor  # (..., n) e
    surface: Tensor  # (..., n) de/dt + K_p/K_d e
    acceleration: Tensor  # (..., n) a


class ComputedTorque(Controller):
    """u = B^-1 (M a + C qd + N), a = d2s/dt2 + K_d de/dt + K_p e + K_i int e + robust(s).

    M, C, N and B are `mechanics` of nominal `parameters`; where these are the plant's, errors obey
    e'' + K_d e' + K_p e = 0. `robust` is a term of s = de/dt + (K_p / K_d) e, in units of
    acceleration; `integral` holds K_i. Source: Slotine and Li, Applied Nonlinear Control, 1991,
    section 9.1.

    Constants: `proportional` K_p [1/s^2] and `derivative` K_d [1/s], numbers or rows (n,), those of
    robust and integral. Raises `ShapeError` for mechanics with other inputs than one a coordinate,
    `DomainError`, `KindError` or `DtypeError`.
    """

    reference_order = 2

    def __init__(
        self,
        mechanics: Mechanics,
        parameters: Any,
        proportional: Numbers = 25.0,
        derivative: Numbers = 10.0,
        robust: BoundaryLayer | None = None,
        integral: IntegralAction | None = None,
    ) -> None:
        super().__init__()
        self.nominal = NominalMechanics(mechanics, parameters)
        self.n_joints = n = self.nominal.n_joints
        self.proportional: Tensor
        self.derivative: Tensor
        self.declare("proportional", proportional, PositiveRow(), (n,))
        self.declare("derivative", derivative, PositiveRow(), (n,))
        self.robust = None if robust is None else instance("robust", robust, BoundaryLayer)
        self.integral = None if integral is None else instance("integral", integral, IntegralAction)

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless there is an input for each of n outputs."""
        check_joints(self.n_joints, n_inputs, n_outputs)

    def form(self) -> int:
        """n."""
        return self.n_joints

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[ErrorIntegral | None, Mode]:
        """The integral of the error, if there is one. Raises `KindError`."""
        check_measured(measurement)
        if self.integral is None:
            return None, None
        return ErrorIntegral(self.integral.initial_state(self.n_joints, batch_shape)), None

    def forward(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ErrorIntegral | None,
        mode: Mode,
    ) -> ControlOutput:
        """u (..., n), time derivative of the state, and signals."""
        wanted, rate, a = reference.upto(2)
        q, qd = measurement.q, measurement.qd
        error, error_rate = wanted - q, rate - qd
        surface = error_rate + self.proportional / self.derivative * error
        a = a + self.derivative * surface
        if self.robust is not None:
            a = a + self.robust(surface)
        kept = None
        if self.integral is not None and state is not None:
            a, kept = a + self.integral(state.integral), ErrorIntegral(error)
        force = self.nominal.force(q, qd, qd, a)
        u = self.nominal.input_of(q, force.unsqueeze(-1))[..., 0]
        return ControlOutput(u, kept, ComputedTorqueSignals(error, surface, a))

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: ErrorIntegral | None
    ) -> InputGains:
        """Of what is fed back of errors, through B^-1 M."""
        shown = output.signals
        q = reference.value - shown.error
        rate = torch.diag_embed(self.derivative.expand(shown.error.shape))
        if self.robust is not None:
            rate = rate + self.robust.slope(shown.surface)
        rate = self.nominal.input_of(q, self.nominal.mass(q) @ rate)
        slope = self.proportional / self.derivative
        return tracking_gains(rate * slope.unsqueeze(-2), rate, reference)
