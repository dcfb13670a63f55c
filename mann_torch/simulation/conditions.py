"""What a step of the loop is under: signals from outside, the plant's numbers, noise, ticks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from torch import Tensor

from ..signals import Outside

#: Reference and disturbances as the loop calls them: of one time, or each sample at its own.
Signals = Callable[[Tensor], Outside]


class Ticks(NamedTuple):
    """Whether sensor and clock tick at a step's start: a bool, or () tensors of a traced step."""

    sensor: Tensor | bool
    clock: Tensor | bool


class Conditions(NamedTuple):
    """All that a step depends on besides the loop, its state and its mode."""

    signals: Signals
    coefficients: Any  # the plant's, from its parameters in force
    noise: Tensor | None = None  # (..., Y) on what is measured
    ticks: Ticks | None = None  # of a loop with a clock or a sensor
