"""Reference trajectories."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64
from ..types import ReferenceSample

#: A reference as the closed loop calls it: its `forward`, or its `aligned`.
Sampler = Callable[[Tensor], ReferenceSample]


class Reference(nn.Module):
    """Interface of a desired trajectory with two derivatives."""

    n_joints: int

    @abstractmethod
    def forward(self, t: Tensor) -> ReferenceSample:
        """The trajectory at times t [s]; each member (*t.shape, ..., n)."""

    def aligned(self, t: Tensor) -> ReferenceSample:
        """Each sample at a time of its own: t (...,) [s] of the batch shape; members (..., n)."""
        count = t.numel()
        members = (part.reshape(count, count, -1) for part in self(t))
        own = (part.diagonal(dim1=0, dim2=1).mT for part in members)
        return ReferenceSample(*(part.reshape(*t.shape, self.n_joints) for part in own))

    @property
    @abstractmethod
    def batch_shape(self) -> torch.Size:
        """Leading batch dimensions `...`."""

    @abstractmethod
    def expand(self, batch_shape: Sequence[int]) -> Reference:
        """The same reference with leading batch dimensions `batch_shape`."""

    @abstractmethod
    def select(self, members: Sequence[int]) -> Reference:
        """Some members of the first batch dimension."""

    @abstractmethod
    def stack(self, references: Sequence[Any]) -> Reference:
        """One reference of this kind with a new leading batch dimension."""


class Sinusoid(Reference):
    """s_j(t) = offset_j + amplitude_j sin(frequency_j t), [rad] and [rad/s].

    Each argument is (..., n) or broadcasts to it; tensors that require grad receive gradients.
    Raises `ConfigError` for values that are not finite, `ShapeError` if no size n is given.
    """

    def __init__(self, amplitude: Numbers, frequency: Numbers = 0.5, offset: Numbers = 0.0) -> None:
        super().__init__()
        given = {"amplitude": amplitude, "frequency": frequency, "offset": offset}
        tensors = [as_float64(value, name) for name, value in given.items()]
        for name, tensor in zip(given, tensors, strict=True):
            if not bool(torch.isfinite(tensor).all()):
                raise ConfigError(f"reference {name} = {tensor.tolist()}: must be finite")
        try:
            tensors = list(torch.broadcast_tensors(*tensors))
        except RuntimeError:
            shapes = ", ".join(f"{n} {tuple(t.shape)}" for n, t in zip(given, tensors, strict=True))
            raise ShapeError(f"reference shapes do not broadcast: {shapes}") from None
        if tensors[0].dim() < 1:
            raise ShapeError("reference: give at least one of its values per joint")
        self.amplitude: Tensor
        self.frequency: Tensor
        self.offset: Tensor
        for name, tensor in zip(given, tensors, strict=True):
            self.register_buffer(name, tensor)
        self.n_joints = tensors[0].shape[-1]

    @property
    def batch_shape(self) -> torch.Size:
        """Leading batch dimensions `...`."""
        return self.amplitude.shape[:-1]

    def expand(self, batch_shape: Sequence[int]) -> Sinusoid:
        """The same sinusoids for a whole batch."""
        shape = (*batch_shape, self.n_joints)
        return Sinusoid(
            self.amplitude.expand(shape), self.frequency.expand(shape), self.offset.expand(shape)
        )

    def select(self, members: Sequence[int]) -> Sinusoid:
        """Some members of the first batch dimension."""
        rows = list(members)
        return Sinusoid(self.amplitude[rows], self.frequency[rows], self.offset[rows])

    def stack(self, references: Sequence[Sinusoid]) -> Sinusoid:
        """Sinusoids of equal shape in one, a row each."""
        return Sinusoid(
            torch.stack([reference.amplitude for reference in references]),
            torch.stack([reference.frequency for reference in references]),
            torch.stack([reference.offset for reference in references]),
        )

    def forward(self, t: Tensor) -> ReferenceSample:
        """s, ds/dt, d2s/dt2 at times t [s]."""
        return self._sample(t.reshape(t.shape + (1,) * self.amplitude.dim()))

    def aligned(self, t: Tensor) -> ReferenceSample:
        """The same at t (...,) [s], each sample at its own."""
        return self._sample(t.unsqueeze(-1))

    def _sample(self, t: Tensor) -> ReferenceSample:
        phase = self.frequency * t
        swing = self.amplitude * torch.sin(phase)
        rate = self.amplitude * self.frequency * torch.cos(phase)
        return ReferenceSample(self.offset + swing, rate, -self.frequency * self.frequency * swing)
