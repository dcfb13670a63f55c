"""One sine per output."""

from __future__ import annotations

import torch
from torch import Tensor

from ..functional import Numbers
from ..types import ReferenceSample
from .reference import Reference
from .rows import broadcast


def swing(amplitude: Tensor, frequency: Tensor, phase: Tensor) -> tuple[Tensor, ...]:
    """amplitude sin(phase) and its first four derivatives, where d phase/dt is `frequency`."""
    value = amplitude * torch.sin(phase)
    rate = amplitude * frequency * torch.cos(phase)
    bend = -frequency * frequency
    acceleration = bend * value
    return value, rate, acceleration, bend * rate, bend * acceleration


class Sinusoid(Reference):
    """s_j(t) = offset_j + amplitude_j sin(frequency_j t), frequencies in [rad/s].

    Each argument is (..., p) or broadcasts to it; tensors that require grad receive gradients.
    Raises `ConfigError` for values that are not finite, `ShapeError` if no size p is given,
    `KindError` or `DtypeError`.
    """

    order = 4

    def __init__(self, amplitude: Numbers, frequency: Numbers = 0.5, offset: Numbers = 0.0) -> None:
        super().__init__()
        self.amplitude: Tensor
        self.frequency: Tensor
        self.offset: Tensor
        given = broadcast("reference", amplitude=amplitude, frequency=frequency, offset=offset)
        for name, rows in given.items():
            self.hold(name, rows)
        self.width = self.amplitude.shape[-1]

    @property
    def _kind(self) -> str:
        return "reference"

    def at(self, t: Tensor) -> ReferenceSample:
        """s and four derivatives."""
        value, *rates = swing(self.amplitude, self.frequency, self.frequency * t)
        return ReferenceSample(self.offset + value, *rates)
