"""What laws and their mechanisms say of themselves, and keep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from ...constraints import DesignModule
from ...interface import Interface
from .drive import Drive


class Keeping(Interface, DesignModule):
    """Something with a state that flows and a mode that jumps, beside estimates (..., N, m)."""

    @property
    def drives(self) -> bool:
        """Whether an error of its own moves estimates, too: that of a pair, or of stored data."""
        return "pair" in self.needs

    @property
    def needs(self) -> frozenset[str]:
        """Fields of `Drive` that it reads and not every controller has."""
        return frozenset()

    @property
    def rows(self) -> int | None:
        """r of the regressors (..., N, r) that it takes; None: any."""
        return None

    @property
    def periods(self) -> tuple[float, ...]:
        """Periods [s] at whose multiples its `jump` samples."""
        return ()

    @property
    def resets(self) -> bool:
        """Whether `jump` can change its state."""
        return False

    def initial_state(self, n_features: int, n_outputs: int, batch_shape: Sequence[int]) -> Any:
        """State at t = 0: None, or a tree of tensors (..., *event)."""
        return None

    def initial_mode(self, n_features: int, n_outputs: int, batch_shape: Sequence[int]) -> Any:
        """What only jumps change, at t = 0: None, or a tree of tensors (..., *event)."""
        return None

    def jump(self, drive: Drive, estimate: Tensor, state: Any, mode: Any) -> tuple[Any, Any]:
        """State and mode after the decisions of one instant."""
        return state, mode
