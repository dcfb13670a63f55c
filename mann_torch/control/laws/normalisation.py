"""Normalisation."""

from __future__ import annotations

from torch import Tensor

from ...functional import Numbers, per_matrix
from .drive import Drive
from .part import Gate


class Normalisation(Gate):
    """s/(1 + tr(Phi' nu Phi)) drives.

    `normalisation` nu is a number or a row of N (a diagonal), a constant. Ioannou and Sun, Robust
    Adaptive Control, ch. 8. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, normalisation: Numbers = 0.0) -> None:
        super().__init__()
        self.normalisation: Tensor
        self.declare_rows("normalisation", normalisation)

    def forward(self, drive: Drive) -> Drive:
        """With the error divided (..., r, m)."""
        weighed = self.per_estimate("normalisation") * drive.regressor.square()
        return drive._replace(error=drive.error / per_matrix(1.0 + weighed.sum(dim=(-2, -1))))
