"""Proportional, integral and derivative action."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import choice, whole
from ..constraints import FiniteRow, NonNegativeRow, PositiveRow
from ..errors import ShapeError
from ..functional import Numbers
from ..trees import portable
from ..types import ControlOutput, InputGains, Mode, ReferenceSample
from .controller import Controller
from .tracking import check_joints, check_measured, tracking_gains

OF = ("error", "output")


@portable
class PidState(NamedTuple):
    """Integral action, and the filter of the derivative, None where rates are measured."""

    integral: Tensor  # (..., n) in the input's units
    filtered: Tensor | None  # (..., n) in the output's units


class PidSignals(NamedTuple):
    """What each action gives (..., n)."""

    proportional: Tensor
    integral: Tensor
    derivative: Tensor
    acting: Tensor  # 1 where the input is within its limit


class Pid(Controller):
    """u = sat(offset + K_p e + z + K_d d), dz/dt = K_i e + w (u - unlimited u), of n loops.

    d is de/dt from measured rates qd, or with `filter_rate` f the filtered derivative
    f s / (s + f) e, of an output that is the first thing measured. `derivative_of` = "output" takes
    that of -y in its place, which no step of the reference kicks. With a `limit` the input stays
    between -limit and limit, and w = `unwinding_rate` lets the integral go: back-calculation.
    Source: Astrom and Hagglund, Advanced PID Control, 2006, chapter 3.

    Constants: `proportional`, `integral`, `derivative`, `offset`, and where they are given `limit`,
    `unwinding_rate` [1/s] and `filter_rate` [1/s]; a number or a row (n,) each. Raises
    `ShapeError`, `DomainError`, `ConfigError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        n_outputs: int,
        proportional: Numbers = 1.0,
        integral: Numbers = 0.0,
        derivative: Numbers = 0.0,
        offset: Numbers = 0.0,
        filter_rate: Numbers | None = None,
        limit: Numbers | None = None,
        unwinding_rate: Numbers = 10.0,
        derivative_of: str = "error",
    ) -> None:
        super().__init__()
        self.n_outputs = n = whole("n_outputs", n_outputs)
        self.derivative_of = choice("derivative_of", derivative_of, OF)
        self.proportional: Tensor
        self.integral: Tensor
        self.derivative: Tensor
        self.offset: Tensor
        self.filter_rate: Tensor
        self.limit: Tensor
        self.unwinding_rate: Tensor
        rows = {
            "proportional": proportional, "integral": integral, "derivative": derivative,
            "offset": offset,
        }  # fmt: skip
        for name, value in rows.items():
            self.declare(name, value, FiniteRow(), (n,))
        self.filters, self.limits = filter_rate is not None, limit is not None
        if filter_rate is not None:
            self.declare("filter_rate", filter_rate, PositiveRow(), (n,))
        if limit is not None:
            self.declare("limit", limit, PositiveRow(), (n,))
            self.declare("unwinding_rate", unwinding_rate, NonNegativeRow(), (n,))
        self.reference_order = 0 if self.filters or self.derivative_of == "output" else 1

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless there is an input for each of n outputs."""
        check_joints(self.n_outputs, n_inputs, n_outputs)

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[PidState, Mode]:
        """No integral; the filter at what it filters.

        Raises `ShapeError` where other than n numbers are measured first, `KindError` where rates
        are wanted and not measured.
        """
        if not self.filters:
            check_measured(measurement, "; or give it a filter_rate [1/s], for the output alone")
        if measurement[0].shape[-1] != self.n_outputs:
            raise ShapeError(
                f"PID of {self.n_outputs} outputs: {measurement[0].shape[-1]} numbers are measured "
                f"as {measurement._fields[0]}"
            )
        shape = (*batch_shape, self.n_outputs)
        filtered = None
        if self.filters:
            filtered = self._watched(reference, measurement[0]).expand(shape)
        return PidState(torch.zeros(shape, dtype=torch.float64), filtered), None

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: PidState, mode: Mode
    ) -> ControlOutput:
        """u (..., n), time derivative of the state, and signals."""
        y = measurement[0]
        error = reference.value - y
        moved: Tensor | None = None
        if state.filtered is not None:
            rate = moved = self.filter_rate * (self._watched(reference, y) - state.filtered)
        elif self.derivative_of == "error":
            rate = reference.upto(1)[1] - measurement.qd
        else:
            rate = -measurement.qd
        pull, damping = self.proportional * error, self.derivative * rate
        u = self.offset + pull + state.integral + damping
        wound, acting = self.integral * error, torch.ones_like(u)
        if self.limits:
            free, u = u, torch.clamp(u, -self.limit, self.limit)
            wound = wound + self.unwinding_rate * (u - free)
            acting = (free.abs() < self.limit).to(u.dtype)
        signals = PidSignals(pull, state.integral, damping, acting)
        return ControlOutput(u, PidState(wound.expand(u.shape), moved), signals)

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: PidState
    ) -> InputGains | None:
        """K_p and K_d, where rates are measured and the limit is not reached."""
        if self.filters:
            return None
        acting = output.signals.acting
        position = torch.diag_embed(acting * self.proportional)
        rate = torch.diag_embed(acting * self.derivative)
        if self.reference_order:
            return tracking_gains(position, rate, reference)
        return InputGains(torch.cat([position, rate], dim=-1), torch.zeros_like(acting))

    def _watched(self, reference: ReferenceSample, y: Tensor) -> Tensor:
        """What is differentiated (..., n)."""
        return reference.value - y if self.derivative_of == "error" else -y
