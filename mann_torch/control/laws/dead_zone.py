"""Dead zone."""

from __future__ import annotations

import torch
from torch import Tensor

from ...constraints import NonNegative
from ...functional import Numbers, per_matrix
from .drive import Drive
from .part import Gate


class DeadZone(Gate):
    """s - sat(s, d) drives: of every error what is beyond `dead_zone` d.

    d is a constant, in units of s. Peterson and Narendra 1982, Bounded error adaptive control.
    Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, dead_zone: Numbers = 0.0) -> None:
        super().__init__()
        self.dead_zone: Tensor
        self.declare("dead_zone", dead_zone, NonNegative())

    def forward(self, drive: Drive) -> Drive:
        """With the error that is left (..., r, m)."""
        error, width = drive.error, per_matrix(self.dead_zone)
        below = torch.where(error < -width, error + width, 0.0)
        return drive._replace(error=torch.where(error > width, error - width, below))
