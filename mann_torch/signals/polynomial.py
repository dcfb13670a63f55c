"""Polynomials in time: a constant, a ramp, a parabola."""

from __future__ import annotations

from torch import Tensor

from ..errors import ShapeError
from ..functional import Numbers
from ..types import ReferenceSample
from .powers import derivatives
from .reference import Reference


class Polynomial(Reference):
    """s_j(t) = sum_k coefficients_kj t^k: rows (..., K, p), the constant first.

    One row is a constant, two are a ramp. Coefficients receive gradients. Raises `ConfigError` for
    values that are not finite, `ShapeError`, `KindError` or `DtypeError`.
    """

    order = 4

    def __init__(self, coefficients: Numbers) -> None:
        super().__init__()
        self.coefficients: Tensor
        rows = self.hold("coefficients", coefficients, 2)
        if rows.shape[-2] < 1:
            raise ShapeError(f"{self._kind} coefficients: give at least one row, the constant")
        self.width = rows.shape[-1]

    def at(self, t: Tensor) -> ReferenceSample:
        """s and four derivatives."""
        return ReferenceSample(*derivatives(self.coefficients.unbind(dim=-2), t, self.order))
