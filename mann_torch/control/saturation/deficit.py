"""A model of what a limited input does to the tracking error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ...constraints import PositiveRow
from ...functional import Numbers, times_column
from ..matrices import MatrixConstants
from .saturation import Saturation


class Deficit(MatrixConstants, Saturation):
    """e_d' = A e_d + B v, from 0: A (n, n) of the reference model, B (n, m) of the input.

    Constants: `deficit_dynamics` and `deficit_input`, A and B row by row, and `input_limit` (m,),
    in the input's units. Its state has a field `e_d`. Raises `ShapeError`, `DomainError`,
    `KindError` or `DtypeError`.
    """

    def __init__(self, A: Numbers, B: Numbers, input_limit: Numbers) -> None:
        super().__init__()
        self.input_limit: Tensor
        self.n_states, self.n_inputs = self.declare_matrix("deficit_input", B, told="B")
        self.declare_matrix("deficit_dynamics", A, self.n_states, self.n_states, "A")
        self.declare("input_limit", input_limit, PositiveRow(), (self.n_inputs,))

    @property
    def limit(self) -> Tensor:
        """(..., m)."""
        return self.input_limit

    def error(self, state: Any) -> Tensor:
        """e_d (..., n)."""
        e_d: Tensor = state.e_d
        return e_d

    def start_of(self, batch_shape: Sequence[int]) -> Tensor:
        """e_d = 0 (..., n)."""
        n = self.matrix("deficit_dynamics").shape[-1]
        return torch.zeros(*batch_shape, n, dtype=torch.float64)

    def moved(self, e_d: Tensor, push: Tensor) -> Tensor:
        """A e_d + B v (..., n), for v (..., m)."""
        natural = times_column(self.matrix("deficit_dynamics"), e_d)
        return natural + times_column(self.matrix("deficit_input"), push)
