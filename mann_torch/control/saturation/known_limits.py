"""Limits that are known, and no more."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ...constraints import PositiveRow
from ...functional import Numbers, as_float64
from .saturation import Saturation


class KnownLimits(Saturation):
    """It tells laws what an input lacks (`FreezeWhileSaturated`), and leaves the error as it is.

    `input_limit` (m,) is a constant, in the input's units. Raises `DomainError`, `KindError` or
    `DtypeError`.
    """

    def __init__(self, input_limit: Numbers) -> None:
        super().__init__()
        rows = as_float64(input_limit, "input_limit")
        rows = rows if rows.dim() else rows.unsqueeze(0)
        self.input_limit: Tensor
        self.n_states, self.n_inputs = None, rows.shape[-1]
        self.declare("input_limit", rows, PositiveRow(), (self.n_inputs,))

    @property
    def limit(self) -> Tensor:
        """(..., m)."""
        return self.input_limit

    def initial_state(self, batch_shape: Sequence[int]) -> None:
        """None."""
        return None

    def error(self, state: None) -> None:
        """None: no part of the error."""
        return None

    def rates(self, state: None, drive: Tensor, excess: Tensor) -> None:
        """None."""
        return None
