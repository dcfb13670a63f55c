"""The gradient law."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from ...constraints import NonNegative
from ...functional import Numbers, outer
from .law import Law


class GradientLaw(Law):
    """d theta/dt = gamma phi s'. Narendra and Annaswamy, Stable Adaptive Systems, 1989.

    `adaptation_rate` is gamma, a constant. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, adaptation_rate: Numbers = 1.0) -> None:
        super().__init__()
        self.adaptation_rate: Tensor
        self.declare("adaptation_rate", adaptation_rate, NonNegative())

    def forward(
        self, regressor: Tensor, error: Tensor, estimate: Tensor, state: Any
    ) -> tuple[Tensor, Any]:
        """gamma phi s' (..., N, m)."""
        return outer(self.adaptation_rate.unsqueeze(-1) * regressor, error), None
