"""What keys compare, by its direction alone."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ...checks import whole

#: Length of a direction at first: inner products lie between -6.25 and 6.25.
LENGTH = 2.5
#: Squared length below which a direction fades to 0 instead of being blown up.
FAINT = 1e-6


class Directions(nn.Linear):
    """length * y / |y| with y = W x + b: (..., I) -> (..., C), for inputs of any size.

    `length`, learned, says how sharply soft attention tells directions apart. Raises `ConfigError`.
    """

    def __init__(self, input_size: int, width: int) -> None:
        super().__init__(whole("input_size", input_size), whole("width", width))
        nn.init.normal_(self.weight)
        self.length = nn.Parameter(torch.tensor(LENGTH))

    def forward(self, x: Tensor) -> Tensor:
        """Directions (..., C)."""
        y = super().forward(x)
        return self.length * y * torch.rsqrt(y.square().sum(dim=-1, keepdim=True) + FAINT)
