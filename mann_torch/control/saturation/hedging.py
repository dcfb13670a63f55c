"""Pseudo-control hedging."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from torch import Tensor

from ...trees import portable
from .deficit import Deficit


@portable
class HedgeState(NamedTuple):
    """What the limits did to the error."""

    e_d: Tensor  # (..., n)


class Hedging(Deficit):
    """e_d' = A e_d + B delta, delta = sat(u) - u, where B is known: the model is hedged.

    It is moved by just what the input did not do. Arguments, constants and errors are those of
    `Deficit`. Johnson and Calise 2000, Pseudo-control hedging: a new method for adaptive control.
    """

    def initial_state(self, batch_shape: Sequence[int]) -> HedgeState:
        """e_d = 0."""
        return HedgeState(self.start_of(batch_shape))

    def rates(self, state: Any, drive: Tensor, excess: Tensor) -> HedgeState:
        """Of e_d."""
        return HedgeState(self.moved(state.e_d, excess))
