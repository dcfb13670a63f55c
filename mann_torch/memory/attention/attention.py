"""The attention interface: who is attended, and when attention is to be shifted."""

from __future__ import annotations

from abc import abstractmethod

import torch
from torch import Tensor

from ...checks import instance
from ...constraints import DesignModule
from ...interface import Interface
from ...types import Comparison, MemoryMode, Shift


class Attention(Interface, DesignModule):
    """Interface of every attention mechanism. Its contract (`mann_torch.testing.check_attention`):

    1. Weights (..., S) are non-negative, of sum 1, and 0 on inactive slots.
    2. Weights and decisions are functions of the arguments and of declared constants alone, for any
       batch at once, decided by `where`, in the arguments' dtype.
    3. Slots have no order: permuted slots have permuted weights, ties aside.
    4. Gradients reach query, keys and constants, and are finite, unused slots or not.
    5. `decide_shift` gives None, always so without `reallocates`, or a `Shift` to one slot: bool,
       or degrees where activity is `graded`.
    6. A mechanism whose weights jump says so by `switches`, and overrides `distances`: its weight
       is 1 on the slot with the least of them, which is infinite for unused slots. If it also
       resets, it overrides `margin`: >= 0 where, and only where, a reset is due. Then its events
       can be located (`rollout(..., gradient="hybrid")`).

    A leaf is one file; nothing else is overridden.
    """

    #: Whether `decide_shift` can ever fire; where False, a rollout skips the test.
    reallocates = False
    #: Whether the weights are those of one slot at a time, the one nearest by `distances`.
    switches = False
    #: Whether all slots are in use from the start.
    starts_full = True
    #: Whether a slot's activity is a level in [0, 1] rather than a bool.
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


def attention_of(value: object) -> Attention:
    """`value`, if it is one. Raises `KindError`."""
    known = (
        "an Attention: SoftAttention(), HardAttention(), ReallocatingAttention() or one of your own"
    )
    return instance("attention", value, Attention, known)
