"""The attention interface: who is attended, and when attention is to be shifted."""

from __future__ import annotations

from abc import abstractmethod

import torch
from torch import Tensor

from ..constraints import DesignModule
from ..types import Comparison, MemoryMode, Shift


class Attention(DesignModule):
    """Interface of every attention mechanism. A leaf is one file; nothing else is overridden.

    A mechanism whose weights jump says so by `switches`, and overrides `distances` (and `margin`,
    if it also resets): then its events can be located (`rollout(..., gradient="hybrid")`).
    """

    #: Whether `decide_shift` can ever fire; where False, a rollout skips the test.
    reallocates = False
    #: Whether the weights are those of one slot at a time, the one nearest by `distances`.
    switches = False
    #: Whether all slots are in use from the start.
    starts_full = True
    #: Whether a slot's activity is a level in [0, 1], float64, rather than a bool.
    graded = False

    @abstractmethod
    def forward(self, comparison: Comparison, active: Tensor) -> Tensor:
        """Weights w_r (..., S): non-negative, sum 1, 0 on inactive slots.

        `comparison` holds the query (..., D), keys (..., S, D) and their scale; `active`
        (..., S) is boolean with at least one True in each row, or activity levels (`graded`).
        """

    @abstractmethod
    def decide_shift(self, distances: Tensor, mode: MemoryMode) -> Shift | None:
        """Whether (or to which degree) to reset a slot, and which; None if this never does.

        `distances` (..., S) are |sigma - mu_i / c_w|_inf, the paper's relevance.
        """

    def distances(self, comparison: Comparison, active: Tensor) -> Tensor:
        """What a switching mechanism takes the least of (..., S), differentiable; inf: unused."""
        raise NotImplementedError(f"{type(self).__name__} does not switch")

    def margin(self, distances: Tensor, mode: MemoryMode) -> Tensor:
        """How far the nearest relevance is beyond theta (...,): a reset is due where >= 0.

        -inf where no reset can come. `distances` as in `decide_shift`.
        """
        return torch.full_like(distances[..., 0], -torch.inf)
