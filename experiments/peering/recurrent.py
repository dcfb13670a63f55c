"""nn.LSTM and nn.GRU with a linear layer on top."""

from __future__ import annotations

from torch import Tensor, nn


class Recurrent(nn.Module):
    """Outputs (T, B, O) of x (T, B, I)."""

    def __init__(self, kind: type[nn.LSTM | nn.GRU], n_inputs: int, size: int, out: int) -> None:
        super().__init__()
        self.rnn, self.output = kind(n_inputs, size), nn.Linear(size, out)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """What comes after a sequence's end changes nothing before it: `valid` isn't needed."""
        return self.output(self.rnn(x)[0])
