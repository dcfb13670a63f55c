"""Linear feedback of what is measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..constraints import FiniteRow
from ..errors import ShapeError
from ..functional import Numbers, as_float64, times_column
from ..types import ControllerTree, ControlOutput, InputGains, Mode, ReferenceSample
from .controller import Controller


class FeedbackSignals(NamedTuple):
    """What linear feedback shows."""

    feedback: Tensor  # (..., m) feedback y
    feedforward: Tensor  # (..., m) feedforward r


class LinearFeedback(Controller):
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
        K = as_float64(feedback, "feedback")
        if K.dim() != 2:
            raise ShapeError(f"feedback of shape {tuple(K.shape)}: give a row (Y,) an input")
        self.n_inputs, self.n_measured = K.shape
        L = None if feedforward is None else as_float64(feedforward, "feedforward")
        if L is not None and (L.dim() != 2 or len(L) != self.n_inputs):
            raise ShapeError(f"feedforward of shape {tuple(L.shape)}: give a row (p,) an input")
        self.n_outputs = None if L is None else L.shape[-1]
        self.feedback: Tensor
        self.feedforward: Tensor
        self.offset: Tensor
        self.declare("feedback", K.reshape(-1), FiniteRow(), (K.numel(),))
        if L is not None:
            self.declare("feedforward", L.reshape(-1), FiniteRow(), (L.numel(),))
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
            raise ShapeError(f"feedback of {self.n_measured} numbers: {found} are measured")
        return None, None

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: ControllerTree, mode: Mode
    ) -> ControlOutput:
        """u (..., m)."""
        y = torch.cat(list(measurement), dim=-1)
        back = times_column(self.feedback.unflatten(-1, (self.n_inputs, -1)), y)
        ahead = torch.zeros_like(back)
        if self.n_outputs is not None:
            ahead = times_column(
                self.feedforward.unflatten(-1, (self.n_inputs, -1)), reference.value
            )
        return ControlOutput(self.offset + ahead - back, None, FeedbackSignals(back, ahead))

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: ControllerTree
    ) -> InputGains:
        """K, and what the reference's motion does."""
        K = self.feedback.unflatten(-1, (self.n_inputs, -1))
        drift = torch.zeros_like(output.input)
        if self.n_outputs is not None and reference.rate is not None:
            L = self.feedforward.unflatten(-1, (self.n_inputs, -1))
            drift = drift + times_column(L, reference.rate)
        return InputGains(K.expand(*output.input.shape, self.n_measured), drift)
