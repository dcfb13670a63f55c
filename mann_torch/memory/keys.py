"""Key rules: what identifies a slot, and what it is compared with."""

from __future__ import annotations

from abc import abstractmethod

import torch
from torch import Tensor

from ..checks import instance
from ..constraints import DesignModule, Positive
from ..errors import ConfigError
from ..functional import Numbers
from ..interface import Interface
from ..types import Comparison, MemoryState


class KeyRule(Interface, DesignModule):
    """Interface of every key rule. Its contract (`mann_torch.testing.check_key_rule`):

    1. `width` is that of keys with a motion of their own, D >= 0, in a context of C numbers.
    2. `query_keys` gives a `Comparison`: query (..., K), keys (..., S, K), scale (...,) or ().
    3. Keys move by `derivative` (..., S, D), a slot of weight 0 not at all. Where `rate` is not 0
       it is how fast: the derivative falls by as much as a key is farther.
    4. A fresh slot's key (..., D) moves nowhere in the context that it is written in.
    5. All are functions of their arguments and of declared constants alone, for any batch at once,
       decided by `where`, in the arguments' dtype; gradients reach them all. What is compared
       depends on the context only if it says so (`compares_context`).
    """

    #: Whether the context is read at all.
    compares_context = True

    @abstractmethod
    def width(self, context_width: int) -> int:
        """Width D of the keys this rule integrates itself; 0 if it has none."""

    @abstractmethod
    def query_keys(
        self, hidden: Tensor, context: Tensor, memory: MemoryState, write_gain: Tensor
    ) -> Comparison:
        """Query and keys from features (..., N), context (..., C) and the memory."""

    @abstractmethod
    def derivative(self, weights: Tensor, context: Tensor, memory: MemoryState) -> Tensor:
        """Time derivative of `memory.keys` (..., S, D)."""

    def rate(self, weights: Tensor) -> Tensor:
        """How fast each key relaxes to what it follows (..., S) [1/s], at weights (..., S).

        With it a discrete step is exact (`MemoryCell`); 0, unless overridden: Euler's step.
        """
        return torch.zeros_like(weights)

    @abstractmethod
    def fresh_keys(self, context: Tensor) -> Tensor:
        """Key (..., D) of a slot that is written anew in this context (..., C)."""


class RepresentationKeys(KeyRule):
    """The contents are the keys: k_i = mu_i, compared as mu_i / c_w with sigma.

    Paper: eqs. (keyupdynrep) and (indsel-1).
    """

    compares_context = False

    def width(self, context_width: int) -> int:
        """0: the contents serve as keys."""
        return 0

    def query_keys(
        self, hidden: Tensor, context: Tensor, memory: MemoryState, write_gain: Tensor
    ) -> Comparison:
        """Query sigma (..., N), keys mu (..., S, N), scale c_w."""
        return Comparison(hidden, memory.mu, write_gain)

    def derivative(self, weights: Tensor, context: Tensor, memory: MemoryState) -> Tensor:
        """Empty (..., S, 0)."""
        return torch.zeros_like(memory.keys)

    def fresh_keys(self, context: Tensor) -> Tensor:
        """Empty (..., 0)."""
        return context[..., :0]


class StateKeys(KeyRule):
    """Keys are points in the plant's state space: dk_i/dt = -c_k w_r(i) (k_i - x).

    `key_rate` is c_k [1/s]. Paper: eqs. (keyupdynst) and (indsel).
    """

    def __init__(self, key_rate: Numbers = 1.0) -> None:
        super().__init__()
        self.key_rate: Tensor
        self.declare("key_rate", key_rate, Positive())

    def width(self, context_width: int) -> int:
        """The context's own width; raises `ConfigError` if there is no context."""
        if context_width < 1:
            raise ConfigError("state keys compare the plant's state: give context_width >= 1")
        return context_width

    def query_keys(
        self, hidden: Tensor, context: Tensor, memory: MemoryState, write_gain: Tensor
    ) -> Comparison:
        """Query x (..., C), keys (..., S, C), scale 1."""
        return Comparison(context, memory.keys, torch.ones_like(write_gain))

    def derivative(self, weights: Tensor, context: Tensor, memory: MemoryState) -> Tensor:
        """-c_k w_r(i) (k_i - x), (..., S, C) [context units / s]."""
        return self.rate(weights).unsqueeze(-1) * (context.unsqueeze(-2) - memory.keys)

    def rate(self, weights: Tensor) -> Tensor:
        """c_k w_r(i) (..., S) [1/s]."""
        return self.key_rate.unsqueeze(-1) * weights

    def fresh_keys(self, context: Tensor) -> Tensor:
        """The context itself (..., C)."""
        return context


def key_rule_of(value: object) -> KeyRule:
    """`value`, if it is one. Raises `KindError`."""
    known = "a KeyRule: StateKeys(), RepresentationKeys() or one of your own"
    return instance("key_rule", value, KeyRule, known)
