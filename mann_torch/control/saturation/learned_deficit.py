"""What an excess does to the error, learned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from torch import Tensor

from ...constraints import Finite, NonNegative
from ...errors import ShapeError
from ...functional import Numbers, as_float64
from ...trees import portable
from .deficit import Deficit


@portable
class LearnedState(NamedTuple):
    """What the limits did to the error, and how much of it an excess does."""

    e_d: Tensor  # (..., n)
    effect: Tensor  # (..., m) beta


class LearnedDeficit(Deficit):
    """e_d' = A e_d + B beta delta, beta' = -gamma s delta, delta = sat(u) - u: beta is learned.

    A (n, n) is the reference model's, B (n, m) the input's, to within a factor beta_i of each
    column. Constants beside those of `Deficit`: `deficit_rate`, gamma. `start` is beta at t = 0, a
    number or (m,). Raises `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        A: Numbers,
        B: Numbers,
        input_limit: Numbers,
        deficit_rate: Numbers = 1.0,
        start: Numbers = 0.0,
    ) -> None:
        super().__init__(A, B, input_limit)
        self.deficit_rate: Tensor
        self.start: Tensor
        self.declare("deficit_rate", deficit_rate, NonNegative())
        first = Finite().check("start", as_float64(start, "start").detach())
        if first.dim() and first.shape != (self.n_inputs,):
            raise ShapeError(f"start of shape {tuple(first.shape)}: give {self.n_inputs} numbers")
        self.register_buffer("start", first.expand(self.n_inputs).clone())

    def initial_state(self, batch_shape: Sequence[int]) -> LearnedState:
        """e_d = 0, and beta at its start."""
        beta = self.start.expand(*batch_shape, self.n_inputs)
        return LearnedState(self.start_of(batch_shape), beta)

    def rates(self, state: Any, drive: Tensor, excess: Tensor) -> LearnedState:
        """Of e_d and beta."""
        effect = -self.deficit_rate.unsqueeze(-1) * drive * excess
        return LearnedState(self.moved(state.e_d, state.effect * excess), effect)
