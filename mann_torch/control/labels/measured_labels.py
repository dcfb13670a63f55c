"""An uncertainty that is measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from ...checks import text
from ..laws import Pair
from .labels import Labels


class MeasuredLabels(Labels):
    """The measurement's last field `field` (..., m) is Delta: an accelerometer's, less the command.

    Raises `KindError`.
    """

    def __init__(self, field: str) -> None:
        super().__init__()
        self.field = text("field", field)

    def initial_state(self, features: int, x: Tensor, batch_shape: Sequence[int]) -> None:
        """None."""
        return None

    def pair(self, measurement: Any, x: Tensor, regressor: Tensor, state: Any) -> Pair:
        """(phi, -Delta)."""
        delta: Tensor = getattr(measurement, str(self.field))
        return Pair(regressor.unsqueeze(-1), -delta.unsqueeze(-2))

    def rates(self, x: Tensor, u: Tensor, regressor: Tensor, state: Any) -> None:
        """None."""
        return None
