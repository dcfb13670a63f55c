"""An uncertainty that filters find."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...constraints import Positive
from ...functional import Numbers, solve_small, times_column
from ...trees import portable
from ..laws import Pair
from ..matrices import MatrixConstants
from .labels import Labels


@portable
class LabelFilters(NamedTuple):
    """First-order filters."""

    x: Tensor  # (..., n) of the state, from the state
    known: Tensor  # (..., n) of A x + B u, from 0
    phi: Tensor  # (..., N) of the features, from 0


class FilteredLabels(MatrixConstants, Labels):
    """Delta_f = B^+ (lambda (x - x_f) - (A x + B u)_f), of x' = A x + B (u + Delta).

    ( )_f is lambda / (s + lambda). As x_f starts at x, lambda (x - x_f) is (x')_f from the first
    instant on, and Delta_f = W*' phi_f is exact there: no derivative is measured. Constants:
    `label_dynamics` A (n, n) and `label_input` B (n, m), of full rank, row by row, and `label_rate`
    lambda [1/s]. Slotine and Li 1989, Composite adaptive control. Raises `ShapeError`,
    `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, A: Numbers, B: Numbers, label_rate: Numbers = 10.0) -> None:
        super().__init__()
        self.label_rate: Tensor
        self.n_states, self.n_inputs = self.declare_matrix("label_input", B, told="B")
        self.declare_matrix("label_dynamics", A, self.n_states, self.n_states, "A")
        self.declare("label_rate", label_rate, Positive())

    def initial_state(self, features: int, x: Tensor, batch_shape: Sequence[int]) -> LabelFilters:
        """x_f = x, all else 0."""
        batch = tuple(batch_shape)
        zero = torch.zeros(*batch, self.n_states, dtype=torch.float64)
        phi = torch.zeros(*batch, features, dtype=torch.float64)
        return LabelFilters(x.expand(*batch, self.n_states), zero, phi)

    def pair(self, measurement: Any, x: Tensor, regressor: Tensor, state: Any) -> Pair:
        """(phi_f, -Delta_f)."""
        rate, B = self.label_rate.unsqueeze(-1), self.matrix("label_input")
        rest = rate * (x - state.x) - state.known
        label = solve_small(B.mT @ B, B.mT @ -rest.unsqueeze(-1))
        return Pair(state.phi.unsqueeze(-1), label.mT)

    def rates(self, x: Tensor, u: Tensor, regressor: Tensor, state: Any) -> LabelFilters:
        """lambda (what goes in - what is held)."""
        A, B = self.matrix("label_dynamics"), self.matrix("label_input")
        rate = self.label_rate.unsqueeze(-1)
        known = times_column(A, x) + times_column(B, u)
        return LabelFilters(
            rate * (x - state.x), rate * (known - state.known), rate * (regressor - state.phi)
        )
