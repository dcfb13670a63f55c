"""A memory that learns while it is used: NeuralMemory of titans-pytorch, an optional package."""

from __future__ import annotations

import importlib.util

from torch import Tensor, nn


def is_installed() -> bool:
    """Whether titans-pytorch can be imported."""
    return importlib.util.find_spec("titans_pytorch") is not None


class Titans(nn.Module):
    """A linear layer, the memory beside a way around it, a linear layer."""

    def __init__(self, n_inputs: int, size: int, out: int) -> None:
        super().__init__()
        from titans_pytorch import NeuralMemory

        self.embed = nn.Linear(n_inputs, size)
        self.memory = NeuralMemory(dim=size, chunk_size=1)  # a write a step, as all others do
        # Only its form is used: what is learned are `memory_model_parameters`, counted once.
        self.memory.memory_model.requires_grad_(False)
        self.output = nn.Linear(size, out)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """Outputs (T, B, O) of x (T, B, I)."""
        known = self.embed(x).transpose(0, 1)  # it takes the batch first
        read, _ = self.memory(known)
        return self.output((known + read).transpose(0, 1))
