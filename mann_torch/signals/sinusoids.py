"""Sums of sines with phases."""

from __future__ import annotations

from torch import Tensor

from ..functional import Numbers
from ..types import ReferenceSample
from .reference import Reference
from .rows import broadcast, spread
from .sinusoid import swing


class Sinusoids(Reference):
    """s_j(t) = offset_j + sum_k amplitude_kj sin(frequency_kj t + phase_kj).

    `amplitude`, `frequency` [rad/s] and `phase` [rad] are (..., K, p) or broadcast to it, `offset`
    to (..., p); tensors that require grad receive gradients. Raises `ConfigError` for values that
    are not finite, `ShapeError`, `KindError` or `DtypeError`.
    """

    order = 4

    def __init__(
        self,
        amplitude: Numbers,
        frequency: Numbers,
        phase: Numbers = 0.0,
        offset: Numbers = 0.0,
    ) -> None:
        super().__init__()
        self.amplitude: Tensor
        self.frequency: Tensor
        self.phase: Tensor
        self.offset: Tensor
        given = broadcast(self._kind, amplitude=amplitude, frequency=frequency, phase=phase)
        for name, rows in given.items():
            self.hold(name, rows, 2)
        self.width = self.amplitude.shape[-1]
        self.hold("offset", spread(f"{self._kind} offset", offset, (self.width,)))
        self.share_batch()

    def at(self, t: Tensor) -> ReferenceSample:
        """s and four derivatives."""
        phase = self.frequency * t.unsqueeze(-1) + self.phase
        parts = swing(self.amplitude, self.frequency, phase)
        value, *rates = (part.sum(dim=-2) for part in parts)
        return ReferenceSample(self.offset + value, *rates)
