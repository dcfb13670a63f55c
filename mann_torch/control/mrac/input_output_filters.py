"""Filters of input and output, in place of a state that is not measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ...constraints import DesignModule, PositiveRow
from ...functional import Numbers, as_float64
from ...trees import portable


@portable
class FilterState(NamedTuple):
    """Filtered inputs and outputs; None without filters."""

    inputs: Tensor | None  # (..., k) w1
    outputs: Tensor | None  # (..., k) w2


class InputOutputFilters(DesignModule):
    """w1' = F w1 + l u, w2' = F w2 + l y: a chain of k lags each, w_i' = p_i (w_(i-1) - w_i).

    `filter_rates` p (k,) [1/s] is a constant: -p_i are the eigenvalues of F, equal ones may be, and
    (F, l) is controllable. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, filter_rates: Numbers = ()) -> None:
        super().__init__()
        rows = as_float64(filter_rates, "filter_rates")
        rows = rows if rows.dim() else rows.unsqueeze(0)
        self.n_filters = rows.shape[-1]
        if self.n_filters:
            self.filter_rates: Tensor
            self.declare("filter_rates", rows, PositiveRow(), (self.n_filters,))

    def initial_state(self, batch_shape: Sequence[int]) -> FilterState:
        """0."""
        if not self.n_filters:
            return FilterState(None, None)
        zero = torch.zeros(*batch_shape, self.n_filters, dtype=torch.float64)
        return FilterState(zero, zero)

    def regressor(self, y: Tensor, command: Tensor, state: FilterState) -> Tensor:
        """[w1, w2, y, r] (..., 2k + 2)."""
        kept = [part for part in state if part is not None]
        return torch.cat([*kept, y, command.expand(*y.shape[:-1], 1)], dim=-1)

    def rates(self, u: Tensor, y: Tensor, state: FilterState) -> FilterState:
        """For an input u (..., 1) and an output y (..., 1)."""
        if state.inputs is None or state.outputs is None:
            return state
        return FilterState(self._moved(u, state.inputs), self._moved(y, state.outputs))

    def _moved(self, entering: Tensor, lags: Tensor) -> Tensor:
        before = torch.cat([entering, lags[..., :-1]], dim=-1)
        return self.filter_rates * (before - lags)
