"""Switching sigma."""

from __future__ import annotations

import torch
from torch import Tensor

from ...constraints import Positive
from ...functional import Numbers
from .drive import Drive
from .part import Leak


class SwitchingSigma(Leak):
    """- Gamma sigma theta, only of columns of estimates that are large.

    sigma is 0 where the norm |theta| of a column is at `sigma_norm` M or below, whole from 2 M on,
    and between them `switching_sigma` (|theta|/M - 1). Both are constants, the second a number or a
    row of N. Ioannou and Kokotovic 1983; Ioannou and Sun, Robust Adaptive Control, 8.4. Raises
    `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, switching_sigma: Numbers = 0.0, sigma_norm: Numbers = 1.0) -> None:
        super().__init__()
        self.switching_sigma: Tensor
        self.sigma_norm: Tensor
        self.declare_rows("switching_sigma", switching_sigma)
        self.declare("sigma_norm", sigma_norm, Positive())

    def forward(self, drive: Drive, estimate: Tensor) -> Tensor:
        """sigma (..., 1 or N, m)."""
        least = self.sigma_norm.unsqueeze(-1).unsqueeze(-1)
        square = estimate.square().sum(dim=-2, keepdim=True)
        large = square > least.square()
        # Where nothing leaks a root of 0 must not be differentiated.
        ratio = torch.where(large, square / least.square(), 1.0).sqrt()
        return self.per_estimate("switching_sigma") * (ratio - 1.0).clamp(max=1.0)
