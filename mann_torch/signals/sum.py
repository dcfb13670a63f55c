"""References added up."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..checks import several
from ..errors import ConfigError, ShapeError
from ..types import ReferenceSample
from .reference import Reference


class Sum(Reference):
    """The sum of `parts`, references of one width; it has the derivatives that all of them have.

    Raises `KindError`, `ConfigError` for no part, or `ShapeError` where widths differ or batch
    shapes do not broadcast.
    """

    def __init__(self, parts: Sequence[Reference]) -> None:
        super().__init__()
        found = several("parts", parts, Reference)
        if not found:
            raise ConfigError("parts of a Sum: give at least one")
        widths = [part.width for part in found]
        if len(set(widths)) != 1:
            raise ShapeError(f"parts of a Sum have widths {widths}: all must be the same")
        self.width, self.order = widths[0], min(part.order for part in found)
        for i, part in enumerate(found):
            self.add_module(f"part_{i}", part)
        batch = self.batch_shape
        for i, part in enumerate(found):  # `select` wants the batch dimensions of each
            self.add_module(f"part_{i}", part.expand(batch))

    @property
    def parts(self) -> tuple[Reference, ...]:
        """What is added up."""
        return tuple(part for part in self.children() if isinstance(part, Reference))

    def at(self, t: Tensor) -> ReferenceSample:
        """The sum and `order` derivatives."""
        samples = [part.at(t).upto(self.order) for part in self.parts]
        return ReferenceSample(*(sum(rest, first) for first, *rest in zip(*samples, strict=True)))
