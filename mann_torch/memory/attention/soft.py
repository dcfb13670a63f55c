"""Soft attention: every active slot takes part, by relevance."""

from __future__ import annotations

from torch import Tensor

from ...functional import masked_softmax, times_column
from ...types import Comparison, MemoryMode, Shift
from .attention import Attention


class SoftAttention(Attention):
    """w_r = softmax(keys' query) over the active slots (the group's earlier paper).

    With representation keys this is softmax(mu' sigma).
    """

    def forward(self, comparison: Comparison, active: Tensor) -> Tensor:
        """Weights (..., S) from the inner products of unscaled keys (..., S, D) and query."""
        return masked_softmax(times_column(comparison.keys, comparison.query), active)

    def decide_shift(self, distances: Tensor, mode: MemoryMode) -> Shift | None:
        """Never shifts: None."""
        return None
