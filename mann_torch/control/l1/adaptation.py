"""What an L1 controller estimates, from the error of its predictor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...constraints import DesignModule
from ...functional import row_times, times_column
from ...interface import Interface
from ...trees import portable
from ..laws import Drive, Law
from ..laws.needs import check_needs


class Estimated(NamedTuple):
    """What is thought to act beside the input."""

    push: Tensor  # (..., d) on the predictor
    matched: Tensor  # (..., m) the part that inputs can cancel


class L1Adaptation(Interface, DesignModule):
    """Estimates for a predictor x^' = A_m x^ + B u + push, driven by x~ = x^ - x."""

    @property
    def periods(self) -> tuple[float, ...]:
        """Periods [s] at whose multiples it samples."""
        return ()

    @property
    def resets(self) -> bool:
        """Whether `jump` can change its state."""
        return False

    @abstractmethod
    def initial_state(self, batch_shape: Sequence[int]) -> tuple[Any, Any]:
        """State and mode at t = 0."""

    @abstractmethod
    def forward(self, x: Tensor, state: Any, mode: Any) -> Estimated:
        """At x (..., d)."""

    @abstractmethod
    def rates(self, x: Tensor, error: Tensor, state: Any, mode: Any) -> Any:
        """Time derivative of the state, at x and x~ (..., d)."""

    @abstractmethod
    def jump(self, x: Tensor, error: Tensor, state: Any, mode: Any) -> tuple[Any, Any]:
        """State and mode after the decisions of one instant."""


@portable
class PredictorGradientState(NamedTuple):
    """Estimated parameters, and what their law keeps."""

    estimate: Tensor  # (..., d, m) theta^
    laws: Any = None


class PredictorGradient(L1Adaptation):
    """push = B theta^'x; the law is driven by x and -B'P x~, where A_m'P + P A_m = -Q."""

    def __init__(self, B: Tensor, through: Tensor, law: Law) -> None:
        super().__init__()
        check_needs(law, {"error_norm"})
        self.law = law
        self.B: Tensor
        self.through: Tensor
        self.register_buffer("B", B.clone())
        self.register_buffer("through", through)

    @property
    def periods(self) -> tuple[float, ...]:
        """Of the law."""
        return self.law.periods

    @property
    def resets(self) -> bool:
        """Whether the law does."""
        return self.law.resets

    def initial_state(self, batch_shape: Sequence[int]) -> tuple[PredictorGradientState, Any]:
        """theta^ = 0, and the law's."""
        sizes = (*self.B.shape, batch_shape)
        estimate = torch.zeros(*batch_shape, *self.B.shape, dtype=torch.float64)
        state = PredictorGradientState(estimate, self.law.initial_state(*sizes))
        return state, self.law.initial_mode(*sizes)

    def forward(self, x: Tensor, state: PredictorGradientState, mode: Any) -> Estimated:
        """theta^'x, through B."""
        matched = row_times(x, state.estimate)
        return Estimated(times_column(self.B, matched), matched)

    def rates(
        self, x: Tensor, error: Tensor, state: PredictorGradientState, mode: Any
    ) -> PredictorGradientState:
        """By the law."""
        rate, kept = self.law(self._drive(x, error), state.estimate, state.laws, mode)
        return PredictorGradientState(rate, kept)

    def jump(
        self, x: Tensor, error: Tensor, state: PredictorGradientState, mode: Any
    ) -> tuple[PredictorGradientState, Any]:
        """By the law."""
        if mode is None and not self.law.resets:
            return state, mode
        kept, mode = self.law.jump(self._drive(x, error), state.estimate, state.laws, mode)
        return state._replace(laws=kept), mode

    def _drive(self, x: Tensor, error: Tensor) -> Drive:
        size = torch.linalg.vector_norm(error, dim=-1)
        return Drive.of_features(x, -times_column(self.through, error), size)
