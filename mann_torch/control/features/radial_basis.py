"""Radial basis functions."""

from __future__ import annotations

import torch
from torch import Tensor

from ...checks import POSITIVE, number, whole
from ...errors import ShapeError
from ...functional import Numbers, as_float64
from .basis import Basis


class RadialBasis(Basis):
    """phi_i = exp(-|z - c_i|^2 / (2 width^2)); `centers` c are (N, I).

    Raises `ShapeError`, `ConfigError`, `KindError` or `DtypeError`.
    """

    def __init__(self, centers: Numbers, width: float = 1.0) -> None:
        super().__init__()
        rows = as_float64(centers, "centers")
        if rows.dim() != 2:
            raise ShapeError(f"centers of shape {tuple(rows.shape)}: give a row (I,) a feature")
        self.n_features, self.n_inputs = rows.shape
        self.width = number("width", width, POSITIVE)
        self.centers: Tensor
        self.register_buffer("centers", rows)

    @classmethod
    def scattered(
        cls, n_inputs: int, n_hidden: int, width: float = 1.0, seed: int = 0
    ) -> RadialBasis:
        """Centers from a standard normal law, by seed."""
        generator = torch.Generator().manual_seed(whole("seed", seed, least=0))
        shape = (whole("n_hidden", n_hidden), whole("n_inputs", n_inputs))
        return cls(torch.randn(*shape, generator=generator, dtype=torch.float64), width)

    def forward(self, nn_input: Tensor) -> Tensor:
        """phi (..., N)."""
        gaps = nn_input.unsqueeze(-2) - self.centers
        return torch.exp(gaps.square().sum(dim=-1) * (-0.5 / self.width**2))

    def slope(self, nn_input: Tensor, features: Tensor) -> Tensor:
        """- phi (z - c) / width^2, (..., N, I)."""
        gaps = self.centers - nn_input.unsqueeze(-2)
        return features.unsqueeze(-1) * gaps / self.width**2
