"""A constant gain."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from ...checks import text
from ...constraints import SymmetricPositiveDefinite
from ...functional import Numbers, as_float64
from .drive import Drive, product
from .part import Gain


class ConstantGain(Gain):
    """Gamma: a number, a row of N (a diagonal), or an SPD matrix (N, N).

    `adaptation_rate` is the constant; `name` gives it another name, where a controller has two
    laws. With it alone the law is the gradient law d theta/dt = Gamma Phi s: Narendra and
    Annaswamy, Stable Adaptive Systems, 1989. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, adaptation_rate: Numbers = 1.0, name: str = "adaptation_rate") -> None:
        super().__init__()
        self._name = name = text("name", name)
        value = as_float64(adaptation_rate, name)
        if value.dim() == 2:
            self.declare(name, value, SymmetricPositiveDefinite(), tuple(value.shape))
        else:
            self.declare_rows(name, value)

    def _times(self, x: Tensor) -> Tensor:
        if self._domains[self._name].event_dims == 2:
            return getattr(self, self._name) @ x
        return self.per_estimate(self._name) * x

    def applied(self, x: Tensor, state: Any) -> Tensor:
        """Gamma x (..., N, m)."""
        return self._times(x)

    def drive(self, drive: Drive, state: Any) -> Tensor:
        """(Gamma Phi) s (..., N, m)."""
        return product(self._times(drive.regressor), drive.error)

    def leaked(self, rate: Tensor, coefficient: Tensor, away: Tensor, state: Any) -> Tensor:
        """rate - (Gamma c) theta (..., N, m)."""
        if self._domains[self._name].event_dims == 2:
            return super().leaked(rate, coefficient, away, state)
        return rate.addcmul(self._times(coefficient), away, value=-1)
