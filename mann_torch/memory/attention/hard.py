"""Hard attention: the nearest slot alone."""

from __future__ import annotations

from torch import Tensor

from ...functional import active_distances, nearest_weights, per_matrix
from ...types import Comparison, MemoryMode, Shift
from .attention import Attention


def attend_nearest(comparison: Comparison, active: Tensor) -> Tensor:
    """Weight 1 on the active slot with the nearest scaled key. (..., S)"""
    scale = per_matrix(comparison.scale)
    return nearest_weights(comparison.query, comparison.keys / scale, active)


def slot_distances(comparison: Comparison, active: Tensor) -> Tensor:
    """Distance of every scaled key from the query; inf for unused slots. (..., S)"""
    scale = per_matrix(comparison.scale)
    return active_distances(comparison.query, comparison.keys / scale, active)


class HardAttention(Attention):
    """w_r(i) = 1 for the slot whose key is nearest to the query (eqs. indsel, indsel-1, factdef).

    All slots are active from the start and none is ever reset.
    """

    switches = True

    def forward(self, comparison: Comparison, active: Tensor) -> Tensor:
        """One-hot weights (..., S); the lowest index wins a tie."""
        return attend_nearest(comparison, active)

    def distances(self, comparison: Comparison, active: Tensor) -> Tensor:
        """|query - key_i / scale|_inf (..., S); inf for unused slots."""
        return slot_distances(comparison, active)

    def decide_shift(self, distances: Tensor, mode: MemoryMode) -> Shift | None:
        """Never shifts: None."""
        return None
