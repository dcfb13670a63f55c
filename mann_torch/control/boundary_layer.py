"""A robustifying term that switches smoothly."""

from __future__ import annotations

import torch
from torch import Tensor

from ..checks import choice
from ..constraints import DesignModule, NonNegative, Positive
from ..functional import Numbers, per_matrix

SHAPES = ("smooth", "saturated")


class BoundaryLayer(DesignModule):
    """k s / (|s| + eps), or k sat(s / eps) number by number: against what no estimate can catch.

    `sliding_gain` is k, in the input's units, and `layer` eps, in those of s; `shape` is ``smooth``
    or ``saturated``. Slotine 1984, Sliding controller design for non-linear systems. Raises
    `DomainError`, `ConfigError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self, sliding_gain: Numbers = 1.0, layer: Numbers = 0.1, shape: str = "smooth"
    ) -> None:
        super().__init__()
        self.shape = choice("shape", shape, SHAPES)
        self.sliding_gain: Tensor
        self.layer: Tensor
        self.declare("sliding_gain", sliding_gain, NonNegative())
        self.declare("layer", layer, Positive())

    def forward(self, error: Tensor) -> Tensor:
        """What is added to the input (..., m) for an error s (..., m)."""
        k, layer = self.sliding_gain.unsqueeze(-1), self.layer.unsqueeze(-1)
        if self.shape == "saturated":
            return k * torch.clamp(error / layer, -1.0, 1.0)
        return k * error / (torch.linalg.vector_norm(error, dim=-1, keepdim=True) + layer)

    def slope(self, error: Tensor) -> Tensor:
        """About d of it / d s (..., m, m), for the implicit solver: its secant."""
        k, layer = self.sliding_gain.unsqueeze(-1), self.layer.unsqueeze(-1)
        if self.shape == "saturated":
            return torch.diag_embed(k / torch.maximum(error.abs(), layer))
        size = torch.linalg.vector_norm(error, dim=-1) + self.layer
        eye = torch.eye(error.shape[-1], dtype=error.dtype, device=error.device)
        return per_matrix(self.sliding_gain / size) * eye
