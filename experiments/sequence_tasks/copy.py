"""Copy: symbols are shown, then nothing for long, then they are to be said again in order."""

from __future__ import annotations

import torch

from ..settings.peers_config import CopyConfig
from .task import Batch, Classification, one_hot


class Copy(Classification):
    """n symbols, `gap` blanks (all zero), then n steps whose last input, the cue, is 1."""

    def __init__(self, cfg: CopyConfig) -> None:
        self.n_symbols, self.length, self.gap = cfg.n_symbols, cfg.length, cfg.gap
        self.n_inputs, self.n_outputs = cfg.n_symbols + 1, cfg.n_symbols

    def draw(self, count: int, generator: torch.Generator) -> Batch:
        """New symbols; what is asked at a cue is the symbol of the same number."""
        n = self.length
        symbols = torch.randint(self.n_symbols, (n, count), generator=generator)
        x = torch.zeros(2 * n + self.gap, count, self.n_inputs)
        x[:n, :, :-1] = one_hot(symbols, self.n_symbols)
        x[-n:, :, -1] = 1.0
        target = torch.zeros(x.shape[:2], dtype=torch.int64)
        target[:n], target[-n:] = symbols, symbols
        asked = x[..., -1] == 1.0
        return Batch(x, target, asked, asked, None)

    def labels(self, batch: Batch, member: int) -> list[str]:
        """The symbols, then a question at each cue."""
        shown = batch.target[: self.length, member].tolist()
        return [*map(str, shown), *[""] * self.gap, *["?"] * self.length]
