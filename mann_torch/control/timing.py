"""What controllers and laws do from time to time: their own watches."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

#: Of a period: rounding of the steps' sum must not put an instant after itself.
TIE = 1e-6


def started(batch_shape: Sequence[int]) -> tuple[Tensor, Tensor]:
    """A watch (...,) [s], that is state and flows by `running`, and how often it was acted on."""
    elapsed = torch.zeros(tuple(batch_shape), dtype=torch.float64)
    return elapsed, torch.zeros(tuple(batch_shape), dtype=torch.int64)


def running(elapsed: Tensor) -> Tensor:
    """Time derivative of a watch: 1 (...,)."""
    return torch.ones_like(elapsed)


def due(elapsed: Tensor, taken: Tensor, period: float, first: float = 0.0) -> Tensor:
    """Whether instant number `taken` of first + k period [s] has come, (...,) bool."""
    return elapsed >= first + period * (taken.to(elapsed.dtype) - TIE)
