"""Linear feedback of what is measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..constraints import FiniteRow
from ..errors import ShapeError
from ..functional import Numbers, times_column
from ..types import ControllerTree, ControlOutput, InputGains, Mode, ReferenceSample
from .controller import Controller
from .matrices import MatrixConstants


class FeedbackSignals(NamedTuple):
    """What linear feedback shows."""

    feedback: Tensor  # (..., m) feedback y
    feedforward: Tensor  # (..., m) feedforward r


class LinearFeedback(MatrixConstants, Controller):
    """u = offset + feedforward r - feedback y: m inputs from p references and Y measured numbers.

    `feedback` is (m, Y), over the fields of the measurement in order, `feedforward` (m, p), 0 if
    not given, `offset` (m,). The constants of these names hold the matrices row by row, in one row
    of numbers. It has no state. Raises `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        feedback: Numbers,
        feedforward: Numbers | None = None,
        offset: Numbers = 0.0,
    ) -> None:
        super().__init__()
        self.offset: Tensor
        self.n_inputs, self.n_measured = self.declare_matrix("feedback", feedback)
        self.n_outputs: int | None = None
        if feedforward is not None:
            _, self.n_outputs = self.declare_matrix("feedforward", feedforward, self.n_inputs)
        self.declare("offset", offset, FiniteRow(), (self.n_inputs,))

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless the matrices are of the plant's sizes."""
        if n_inputs != self.n_inputs or self.n_outputs not in (None, n_outputs):
            raise ShapeError(
                f"a plant of {n_inputs} inputs and {n_outputs} outputs got linear feedback of "
                f"{self.n_inputs} inputs and {self.n_outputs} references"
            )

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[ControllerTree, Mode]:
        """None. Raises `ShapeError` unless Y numbers are measured."""
        found = sum(part.shape[-1] for part in measurement)
        if found != self.n_measured:
            fields = ", ".join(measurement._fields)
            raise ShapeError(
                f"feedback of {self.n_measured} numbers: {found} are measured ({fields})"
            )
        return None, None

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: ControllerTree, mode: Mode
    ) -> ControlOutput:
        """u (..., m)."""
        y = torch.cat(list(measurement), dim=-1)
        back = times_column(self.matrix("feedback"), y)
        ahead = torch.zeros_like(back)
        if self.n_outputs is not None:
            ahead = times_column(self.matrix("feedforward"), reference.value)
        return ControlOutput(self.offset + ahead - back, None, FeedbackSignals(back, ahead))

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: ControllerTree
    ) -> InputGains:
        """K, and what the reference's motion does."""
        K = self.matrix("feedback")
        drift = torch.zeros_like(output.input)
        if self.n_outputs is not None and reference.rate is not None:
            L = self.matrix("feedforward")
            drift = drift + times_column(L, reference.rate)
        return InputGains(K.expand(*output.input.shape, self.n_measured), drift)
