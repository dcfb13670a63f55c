"""Values that jump at given times."""

from __future__ import annotations

from torch import Tensor

from ..functional import Numbers
from ..types import ReferenceSample
from .reference import Reference
from .rows import finite_rows
from .schedule import PiecewiseConstant


class Steps(Reference):
    """Row k of `values` (..., K + 1, p) from time k - 1 (included) to time k of `times` (..., K).

    Times [s] increase and are > 0; inf pads a sample with fewer steps, and stacking pads. Values
    that require grad receive gradients. There are no derivatives: it jumps. Raises `ConfigError`,
    `KindError`, `DtypeError` or `ShapeError`.
    """

    order = 0

    def __init__(self, times: Numbers, values: Numbers) -> None:
        super().__init__()
        self.schedule = PiecewiseConstant(times, values)
        self.width = finite_rows(f"{self._kind} values", self.schedule.values).shape[-1]

    def at(self, t: Tensor) -> ReferenceSample:
        """The values in force."""
        return ReferenceSample(self.schedule.in_force(t))
