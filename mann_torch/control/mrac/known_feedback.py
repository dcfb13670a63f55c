"""What of a controller's input is known beforehand."""

from __future__ import annotations

import torch
from torch import Tensor

from ...functional import Numbers, times_column
from ..matrices import MatrixConstants


class KnownFeedback(MatrixConstants):
    """K_r r - K_x x + K_e e, of what is given.

    Constants, row by row: `feedforward` (m, p), `feedback` (m, n), `error_feedback` (m, n).
    Raises `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        sizes: tuple[int, int, int],
        feedback: Numbers | None = None,
        feedforward: Numbers | None = None,
        error_feedback: Numbers | None = None,
    ) -> None:
        super().__init__()
        m, n, p = self.sizes = sizes
        for name, value, columns in (
            ("feedforward", feedforward, p),
            ("feedback", feedback, n),
            ("error_feedback", error_feedback, n),
        ):
            if value is not None:
                self.declare_matrix(name, value, m, columns)

    def forward(self, u: Tensor, command: Tensor, x: Tensor, error: Tensor) -> Tensor:
        """u (..., m), and these terms."""
        given = {"feedforward": command, "feedback": x, "error_feedback": error}
        for name in self.domains():
            term = times_column(self.matrix(name), given[name])
            u = u - term if name == "feedback" else u + term
        return u

    def slope(self) -> Tensor:
        """-d u/d x (..., m, n), where e = x_m - x."""
        total = torch.zeros(self.sizes[:2], dtype=torch.float64)
        for name in self.domains():
            total = total if name == "feedforward" else total + self.matrix(name)
        return total
