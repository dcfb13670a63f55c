"""What a step of the loop is under: signals from outside, the plant's numbers, noise, ticks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..signals import Outside

#: Reference and disturbances as the loop calls them: of one time, or each sample at its own.
Signals = Callable[[Tensor], Outside]


class Ticks(NamedTuple):
    """Whether sensor and clock tick at a step's start: a bool, or () tensors of a traced step."""

    sensor: Tensor | bool
    clock: Tensor | bool


class Span(NamedTuple):
    """A step without its ends: of signals that jump there, what holds within it."""

    first: Tensor  # () [s]
    last: Tensor  # () [s]


class Conditions(NamedTuple):
    """All that a step depends on besides the loop, its state and its mode."""

    signals: Signals
    coefficients: Any  # the plant's, from its parameters in force
    noise: Tensor | None = None  # (..., Y) on what is measured
    ticks: Ticks | None = None  # of a loop with a clock or a sensor
    span: Span | None = None  # where signals jump

    def within(self, t: Tensor) -> Outside:
        """What acts from outside at a time t [s] of this step: at its ends, what holds within."""
        if self.span is not None:
            t = torch.minimum(torch.maximum(t, self.span.first), self.span.last)
        return self.signals(t)


#: By how much of a step a span is shorter, at each end; and at least, of the time itself: rounding
#: of a jump's time must not put it on the other side.
SHY, ROUNDING = 1e-9, 2.0**-50


def spans_of(times: Tensor) -> Span:
    """Of all steps of a grid (T + 1,) [s], each (T,)."""
    sizes = times.diff()
    shy = torch.minimum(torch.maximum(SHY * sizes, ROUNDING * times[1:]), 0.25 * sizes)
    return Span(times[:-1] + shy, times[1:] - shy)
