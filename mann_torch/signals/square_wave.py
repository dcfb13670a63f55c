"""A wave of two values."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..errors import ConfigError
from ..functional import Numbers
from ..types import ReferenceSample
from .reference import Reference
from .rows import broadcast


class SquareWave(Reference):
    """offset_j + amplitude_j in the first half of a period, offset_j - amplitude_j in the second.

    `period` [s]; `phase` [rad] is where in the period, of 2 pi, the wave is at t = 0. Each argument
    is (..., p) or broadcasts to it; amplitude and offset receive gradients, times of jumps have
    none. There are no derivatives: it jumps. Raises `ConfigError` for values that are not finite or
    a period <= 0, `ShapeError`, `KindError` or `DtypeError`.
    """

    order = 0

    def __init__(
        self,
        amplitude: Numbers,
        period: Numbers,
        offset: Numbers = 0.0,
        phase: Numbers = 0.0,
    ) -> None:
        super().__init__()
        self.amplitude: Tensor
        self.period: Tensor
        self.offset: Tensor
        self.phase: Tensor
        given = broadcast(
            self._kind, amplitude=amplitude, period=period, offset=offset, phase=phase
        )
        for name, rows in given.items():
            self.hold(name, rows)
        if bool((self.period <= 0).any()):
            raise ConfigError(f"{self._kind} period = {self.period.tolist()}: must be > 0")
        self.width = self.amplitude.shape[-1]

    def at(self, t: Tensor) -> ReferenceSample:
        """The value, at a jump that after it."""
        turns = t / self.period + self.phase / (2.0 * math.pi)
        first = turns - torch.floor(turns) < 0.5
        return ReferenceSample(self.offset + torch.where(first, self.amplitude, -self.amplitude))
