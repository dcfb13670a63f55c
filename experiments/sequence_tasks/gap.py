"""Classification over a long gap: which symbol came first?"""

from __future__ import annotations

import torch

from ..settings.peers_config import GapConfig
from .task import Batch, Classification, one_hot


class Gap(Classification):
    """The class is the first symbol; symbols of the same kind follow, and say nothing.

    Lengths are uniform in [shortest, longest]; the question is the last valid step. After it, the
    inputs are 0 and not valid.
    """

    def __init__(self, cfg: GapConfig) -> None:
        self.n_classes, self.shortest, self.longest = cfg.n_classes, cfg.shortest, cfg.longest
        self.n_inputs = self.n_outputs = cfg.n_classes

    def draw(self, count: int, generator: torch.Generator) -> Batch:
        """New symbols, as long as the longest of all."""
        T = self.longest
        symbols = torch.randint(self.n_classes, (T, count), generator=generator)
        lengths = torch.randint(self.shortest, T + 1, (count,), generator=generator)
        step = torch.arange(T).unsqueeze(-1)
        valid, last = step < lengths, step == lengths - 1
        x = one_hot(symbols, self.n_classes) * valid.unsqueeze(-1)
        return Batch(x, symbols[:1].expand(T, count), last, last, valid)

    def labels(self, batch: Batch, member: int) -> list[str]:
        """The first symbol, and where it is asked for."""
        last = batch.asked[:, member].tolist()
        first = str(int(batch.target[0, member]))
        return [first, *("?" if mark else "" for mark in last[1:])]
