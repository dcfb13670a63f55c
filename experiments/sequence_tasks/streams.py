"""Functions that a stream changes between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Stream:
    """K functions a seed: f_k(x) = sum_j c_kj sin(1.5 j x + phase_kj), x uniform in [-1, 1]."""

    amplitude: Tensor  # (B, K, J)
    phase: Tensor  # (B, K, J)

    def value(self, k: int, x: Tensor) -> Tensor:
        """f_k(x) for x (..., B)."""
        return _waves(self.amplitude[:, k], self.phase[:, k], x)

    def values(self, which: Tensor, x: Tensor) -> Tensor:
        """f_which(x) for x (T, B) and `which` (T, B) int64, a function of its own each step."""
        seed = torch.arange(which.shape[1])
        return _waves(self.amplitude[seed, which], self.phase[seed, which], x)


def draw_stream(
    seeds: int, n_functions: int, generator: torch.Generator, n_waves: int = 3
) -> Stream:
    """New functions for every seed."""
    shape = (seeds, n_functions, n_waves)
    normal = torch.randn(*shape, generator=generator, dtype=torch.float64)
    phase = math.pi * uniform(generator, *shape)
    return Stream(normal / torch.arange(1, n_waves + 1), phase)


def uniform(generator: torch.Generator, *shape: int) -> Tensor:
    """float64 in [-1, 1]."""
    return 2.0 * torch.rand(*shape, generator=generator, dtype=torch.float64) - 1.0


def _waves(amplitude: Tensor, phase: Tensor, x: Tensor) -> Tensor:
    wave = 1.5 * torch.arange(1, phase.shape[-1] + 1) * x.unsqueeze(-1)
    return (amplitude * torch.sin(wave + phase)).sum(dim=-1)
