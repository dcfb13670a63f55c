"""Smooth projection into a ball."""

from __future__ import annotations

import torch
from torch import Tensor

from ...constraints import Positive
from ...functional import Numbers
from .part import GainInForce, Guard


class Projection(Guard):
    """Keeps the norm of every column of estimates at `bound` B or below.

    f = ((1 + eps) |theta|^2 - B^2) / (eps B^2) with eps = `margin`, both constants. Where f > 0 and
    y' grad f > 0, the rate y becomes y - Gamma grad f (grad f' y) f / (grad f' Gamma grad f).
    Lavretsky and Gibson, arXiv 1112.4232. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, bound: Numbers = 10.0, margin: Numbers = 0.1) -> None:
        super().__init__()
        self.bound: Tensor
        self.margin: Tensor
        self.declare("bound", bound, Positive())
        self.declare("margin", margin, Positive())

    def forward(self, rate: Tensor, estimate: Tensor, gain: GainInForce) -> Tensor:
        """The projected rate (..., N, m)."""
        # grad f is a multiple of theta, and the multiple cancels.
        square = self.bound.square()
        level = (1.0 + self.margin).unsqueeze(-1) * estimate.square().sum(dim=-2)
        f = (level - square.unsqueeze(-1)) / (self.margin * square).unsqueeze(-1)
        outward = (estimate * rate).sum(dim=-2)
        normal = gain.applied(estimate)
        size = (estimate * normal).sum(dim=-2)
        acts = (f > 0) & (outward > 0)
        cut = torch.where(acts, f * outward / torch.where(acts, size, 1.0), 0.0)
        return torch.where(acts.unsqueeze(-2), rate - normal * cut.unsqueeze(-2), rate)
