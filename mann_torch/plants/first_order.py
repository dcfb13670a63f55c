"""States of plants that are one row of numbers."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from ..trees import portable


@portable
class RowState(NamedTuple):
    """A state that is one row."""

    x: Tensor  # (..., d), in the plant's units


class MeasuredOutput(NamedTuple):
    """What a controller sees where the output alone is measured."""

    y: Tensor  # (..., p), in the outputs' units
