"""Smooth projection into a box."""

from __future__ import annotations

import torch
from torch import Tensor

from ...constraints import Positive
from ...functional import Numbers, per_matrix
from .part import GainInForce, Guard


class BoxProjection(Guard):
    """Keeps every estimate between -`bound` B and B.

    f_i = ((1 + eps) theta_i^2 - B^2) / (eps B^2) with eps = `margin`, both constants. Where f_i > 0
    and the rate y_i leads outwards, it becomes y_i (1 - f_i): `Projection` of one number, each on
    its own. Lyapunov's function does not mind where the gain is a number or a row. Hovakimyan and
    Cao, L1 Adaptive Control Theory, 2010. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, bound: Numbers = 10.0, margin: Numbers = 0.1) -> None:
        super().__init__()
        self.bound: Tensor
        self.margin: Tensor
        self.declare("bound", bound, Positive())
        self.declare("margin", margin, Positive())

    def forward(self, rate: Tensor, estimate: Tensor, gain: GainInForce) -> Tensor:
        """The projected rate (..., N, m)."""
        square, margin = per_matrix(self.bound.square()), per_matrix(self.margin)
        f = ((1.0 + margin) * estimate.square() - square) / (margin * square)
        acts = (f > 0) & (estimate * rate > 0)
        return torch.where(acts, rate * (1.0 - f), rate)
