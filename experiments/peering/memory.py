"""The memory cell over a sequence, in the forms that are compared."""

from __future__ import annotations

from torch import Tensor, nn

import mann_torch as mt

from ..settings.peers_config import PeersConfig

#: `memory` is the cell with its defaults, `memory_paper` the paper's law.
MEMORIES = ("memory", "memory_paper")


def build_cell(cfg: PeersConfig, variant: str, n_inputs: int, size: int, out: int) -> mt.MemoryCell:
    """The cell of a variant, with its defaults."""
    make = mt.MemoryCell.paper if variant == "memory_paper" else mt.MemoryCell
    return make(n_inputs, size, cfg.n_slots, output_size=out)


class Memory(nn.Module):
    """Outputs (T, B, O) of x (T, B, I)."""

    def __init__(self, cell: mt.MemoryCell) -> None:
        super().__init__()
        self.sequence = mt.MemorySequence(cell)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """No step is taken where `valid` (T, B) is False."""
        return self.sequence(x, valid=valid)[0]
