"""Slotine and Li's adaptive controller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..constraints import Finite
from ..errors import ShapeError
from ..functional import Numbers, as_float64, times_column
from ..trees import portable
from ..types import ControlOutput, InputGains, Measurement, Mode, ReferenceSample, TrackingError
from .boundary_layer import BoundaryLayer
from .controller import Controller
from .error_feedback import ErrorFeedback
from .integral import IntegralAction
from .laws import AdaptiveLaw, Drive, Law
from .laws.needs import check_needs
from .mechanics import Mechanics, parameter_count
from .tracking import FilteredTracking, check_joints, check_measured, tracking_gains


@portable
class SlotineLiState(NamedTuple):
    """Estimated parameters, what their law keeps, and the integral of r."""

    estimate: Tensor  # (..., k, 1) a^
    laws: Any = None
    integral: Tensor | None = None  # (..., n) [rad]


class SlotineLiSignals(NamedTuple):
    """What the controller shows."""

    tracking: TrackingError
    forward: Tensor  # (..., n) Y a^ [N m]


class SlotineLi(Controller):
    """tau = Y(q, qd, v, v') a^ + K_D r with v = ds/dt + Lambda e and r = v - qd; da^/dt by a law.

    The law is driven by Phi = Y' and r: alone, with a gain Gamma, da^/dt = Gamma Y' r. `robust`
    adds a boundary layer's term of r, `integral` K_i times the integral of r. The mechanics give Y,
    a `MechanicalPlant` does; their inputs are the coordinates' own forces. Source: Slotine and Li
    1987, On the adaptive control of robot manipulators.

    Constants: `error_gain` Lambda [1/s] and `feedback` K_D (a number, n diagonal entries or an SPD
    matrix), those of law, robust and integral. `start` is a^ at t = 0: one number or k.

    Raises `ConfigError` for mechanics without a regressor, or a law that needs a drive of another
    kind; `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    reference_order = 2

    def __init__(
        self,
        mechanics: Mechanics,
        law: Law | None = None,
        error_gain: Numbers = 5.0,
        feedback: Numbers = 20.0,
        start: Numbers = 0.0,
        robust: BoundaryLayer | None = None,
        integral: IntegralAction | None = None,
    ) -> None:
        super().__init__()
        self.mechanics = instance("mechanics", mechanics, Mechanics)
        self.n_joints, self.n_parameters = mechanics.n_joints, parameter_count(mechanics)
        self.law = instance("law", AdaptiveLaw() if law is None else law, Law)
        check_needs(self.law, {"error_norm"}, self.n_joints)
        self.tracking = FilteredTracking(self.n_joints, error_gain)
        self.pushing = ErrorFeedback(self.n_joints, feedback, robust, integral)
        k = self.n_parameters
        rows = Finite().check("start", as_float64(start, "start").detach())
        if rows.dim() and rows.shape[-1] != k:
            raise ShapeError(f"start of shape {tuple(rows.shape)}: give {k} numbers, or one")
        self.start: Tensor
        self.register_buffer("start", (rows if rows.dim() else rows.expand(k)).clone())

    @property
    def reallocates(self) -> bool:  # type: ignore[override]
        """Whether its law's state can jump."""
        return self.law.resets

    @property
    def periods(self) -> tuple[float, ...]:  # type: ignore[override]
        """Of its law."""
        return self.law.periods

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
    ) -> tuple[SlotineLiState, Mode]:
        """State and the law's mode at t = 0. Raises `KindError`."""
        check_measured(measurement)
        sizes = (self.n_parameters, 1, batch_shape)
        estimate = self.start.expand(*batch_shape, self.n_parameters).unsqueeze(-1)
        integral = self.pushing.initial_state(batch_shape)
        state = SlotineLiState(estimate, self.law.initial_state(*sizes), integral)
        return state, self.law.initial_mode(*sizes)

    def forward(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: SlotineLiState,
        mode: Mode,
    ) -> ControlOutput:
        """tau (..., n), time derivative of the state, and signals."""
        tracking, Y = self._look(reference, measurement)
        r = tracking.filtered_error
        ahead = (Y @ state.estimate)[..., 0]
        tau = ahead + self.pushing(r, state.integral)
        rate, kept = self.law(_drive(tracking, Y), state.estimate, state.laws, mode)
        rates = SlotineLiState(rate, kept, None if state.integral is None else r)
        return ControlOutput(tau, rates, SlotineLiSignals(tracking, ahead))

    def jump(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: SlotineLiState,
        mode: Mode,
    ) -> tuple[SlotineLiState, Mode]:
        """Decisions of the law."""
        if mode is None and not self.law.resets:
            return state, mode
        drive = _drive(*self._look(reference, measurement))
        kept, mode = self.law.jump(drive, state.estimate, state.laws, mode)
        return state._replace(laws=kept), mode

    def held(self, before: SlotineLiState, after: SlotineLiState) -> SlotineLiState:
        """Estimates and what their law keeps stay."""
        return after._replace(estimate=before.estimate, laws=before.laws)

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: SlotineLiState
    ) -> InputGains:
        """Of the feedback of r, K_D [Lambda, 1]; the regressor's part is not solved for."""
        rate = self.pushing.slope(output.signals.tracking.filtered_error)
        return tracking_gains(rate @ self.tracking.error_gain, rate, reference)

    def _look(
        self, reference: ReferenceSample, measurement: Measurement
    ) -> tuple[TrackingError, Tensor]:
        """Errors, and Y (..., n, k) at v and v'."""
        q, qd = measurement.q, measurement.qd
        tracking: TrackingError = self.tracking(reference, measurement)
        acceleration = reference.upto(2)[2]
        pull = times_column(self.tracking.error_gain, tracking.error_rate)
        v = qd + tracking.filtered_error
        return tracking, self.mechanics.regressor(q, qd, v, acceleration + pull)


def _drive(tracking: TrackingError, Y: Tensor) -> Drive:
    error_norm = torch.linalg.vector_norm(tracking.error, dim=-1)
    return Drive(Y.mT, tracking.filtered_error.unsqueeze(-1), error_norm)
