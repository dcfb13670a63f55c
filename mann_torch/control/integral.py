"""Integral action."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..constraints import DesignModule, NonNegativeRow
from ..errors import ShapeError
from ..functional import Numbers, as_float64


class IntegralAction(DesignModule):
    """K_i z, dz/dt = s: what takes a constant offset away.

    `integral_gain` K_i is a number or a row (m,), in the input's units over those of s, times 1/s.
    Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, integral_gain: Numbers = 1.0) -> None:
        super().__init__()
        self.integral_gain: Tensor
        rows = as_float64(integral_gain, "integral_gain")
        rows = rows if rows.dim() else rows.unsqueeze(0)
        self.declare("integral_gain", rows, NonNegativeRow(), (rows.shape[-1],))

    def initial_state(self, n_outputs: int, batch_shape: Sequence[int]) -> Tensor:
        """z = 0 (..., m). Raises `ShapeError` where K_i is a row of another width."""
        width = self.integral_gain.shape[-1]
        if width not in (1, n_outputs):
            raise ShapeError(f"integral_gain has {width} numbers: give 1 or {n_outputs}")
        return torch.zeros(*batch_shape, n_outputs, dtype=torch.float64)

    def forward(self, integral: Tensor) -> Tensor:
        """What is added to the input (..., m), for z (..., m)."""
        return self.integral_gain * integral
