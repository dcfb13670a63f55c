"""One causal layer of self-attention, with positions."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

HEADS = 2


class CausalAttention(nn.Module):
    """A linear layer, sinusoidal positions, a transformer's layer (two heads), a linear layer."""

    def __init__(self, n_inputs: int, size: int, out: int) -> None:
        super().__init__()
        self.size = size
        self.embed = nn.Linear(n_inputs, size)
        self.layer = nn.TransformerEncoderLayer(size, HEADS, 2 * size, 0.0, norm_first=True)
        self.output = nn.Linear(size, out)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """Outputs (T, B, O) of x (T, B, I); a step sees none that come after it."""
        mask = nn.Transformer.generate_square_subsequent_mask(len(x), x.device, x.dtype)
        known = self.embed(x) + positions(len(x), self.size).to(x).unsqueeze(1)
        return self.output(self.layer(known, src_mask=mask, is_causal=True))


def positions(steps: int, size: int) -> Tensor:
    """Sines and cosines (steps, size) of periods from 2 pi up to 10^4 times that (Vaswani 2017)."""
    half = size // 2
    pace = torch.exp(-math.log(1e4) * torch.arange(half) / half)
    angle = torch.arange(steps).unsqueeze(-1) * pace
    return torch.cat([torch.sin(angle), torch.cos(angle)], dim=-1)
