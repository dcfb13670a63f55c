"""The interface of what measures an uncertainty."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

from torch import Tensor

from ...constraints import DesignModule
from ...interface import Interface
from ..laws import Pair


class Labels(Interface, DesignModule):
    """Where a law's measured regression comes from: of x' = A x + B (u + Delta), Delta = W*' phi.

    Its contract: what is sought is theta* = -W*, which cancels Delta, so that a label (..., 1, m)
    of a regressor (..., N, 1) is that of -Delta. State is a NamedTuple of its own, or None, that
    flows by `rates`. `field` is the field of the measurement that it reads and that is no part of
    the state x, the measurement's last, or None.
    """

    field: str | None = None

    @abstractmethod
    def initial_state(self, features: int, x: Tensor, batch_shape: Sequence[int]) -> Any:
        """State at t = 0, for N features and x (..., n) there."""

    @abstractmethod
    def pair(self, measurement: Any, x: Tensor, regressor: Tensor, state: Any) -> Pair:
        """The regression, for features phi (..., N)."""

    @abstractmethod
    def rates(self, x: Tensor, u: Tensor, regressor: Tensor, state: Any) -> Any:
        """d state/dt, at an input u (..., m) that is applied."""
