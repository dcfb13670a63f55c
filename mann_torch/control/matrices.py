"""Matrices of any shape as constants: row by row, in one row of numbers."""

from __future__ import annotations

from torch import Tensor

from ..constraints import DesignModule, FiniteRow
from ..errors import ShapeError
from ..functional import Numbers, as_float64


class MatrixConstants(DesignModule):
    """A module that declares matrices."""

    def declare_matrix(
        self,
        name: str,
        value: Numbers,
        rows: int | None = None,
        columns: int | None = None,
        told: str = "",
    ) -> tuple[int, int]:
        """Its shape; None is any number of rows or columns. Raises `ShapeError` and as `declare`.

        The constant `name` holds it row by row, and `matrix` gives it back. An error calls it as it
        was `told`, by another name, maybe.
        """
        told = told or name
        matrix = as_float64(value, told)
        sizes = tuple(matrix.shape)
        fits = len(sizes) == 2 and rows in (None, sizes[0]) and columns in (None, sizes[1])
        if not fits or 0 in sizes:
            wanted = ", ".join("any" if n is None else str(n) for n in (rows, columns))
            raise ShapeError(f"{told} of shape {sizes}: give a matrix ({wanted})")
        self.declare(name, matrix.reshape(-1), FiniteRow(), (matrix.numel(),))
        self._columns = {**getattr(self, "_columns", {}), name: sizes[1]}
        return sizes[0], sizes[1]

    def matrix(self, name: str) -> Tensor:
        """The matrix of this name (..., a, b)."""
        rows: Tensor = getattr(self, name)
        return rows.unflatten(-1, (-1, self._columns[name]))
