"""The interface of reference signals."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from torch import Tensor

from ..interface import Interface
from ..types import ReferenceSample
from .rows import Rows

#: A signal as the closed loop calls it: its `forward`, or its `aligned`.
Sampler = Callable[[Tensor], ReferenceSample]


class Reference(Interface, Rows):
    """A signal in time, desired or disturbing. Its contract (`mann_torch.testing.check_reference`):

    1. What it is made of are rows (..., *event), registered by `hold`: `expand`, `select`, `stack`
       and `batch_shape` come of them.
    2. `width` is p, `order` the number of time derivatives it has.
    3. `at` gives value and derivatives, each (..., p), at times t that broadcast with rows
       (..., p): all of any batch at once, decided by `where`.
    4. Where it jumps, the value is that from the right, and `jumps` says when.
    """

    width: int
    #: How many time derivatives it has.
    order: int = 2

    @abstractmethod
    def at(self, t: Tensor) -> ReferenceSample:
        """Value and `order` derivatives at times t [s], (..., 1) beside rows (..., p)."""

    def jumps(self, end: float) -> list[float]:
        """Times in (0, end) [s] at which the value of any sample jumps: a solver's steps end there.

        Those of its parts here, or none.
        """
        parts = [part for part in self._parts().values() if isinstance(part, Reference)]
        return sorted({time for part in parts for time in part.jumps(end)})

    def forward(self, t: Tensor) -> ReferenceSample:
        """The signal at times t [s]; each member (*t.shape, ..., p)."""
        return self.at(t.reshape(t.shape + (1,) * (self._batch_dims() + 1)))

    def aligned(self, t: Tensor) -> ReferenceSample:
        """Each sample at a time of its own: t (...,) [s] of the batch shape; members (..., p)."""
        return self.at(t.unsqueeze(-1))
