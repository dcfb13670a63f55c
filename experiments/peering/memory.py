"""The memory cell over a sequence, in the forms that are compared."""

from __future__ import annotations

from typing import Any

from torch import Tensor, nn

import mann_torch as mt

from ..settings.peers_config import PeersConfig

#: How cells differ from `memory`, the one with its defaults; `memory_paper` is the paper's law.
CELLS: dict[str, dict[str, Any]] = {
    "memory": {},
    "no_inertia": {"inertia": False},
    "no_clock": {"clock": False},
    "written_where_read": {"writing": "attended"},
    "one_slot": {"n_slots": 1},
    "memory_paper": {},
}
MEMORIES = tuple(CELLS)


def build_cell(cfg: PeersConfig, variant: str, n_inputs: int, size: int, out: int) -> mt.MemoryCell:
    """The cell of a variant."""
    make = mt.MemoryCell.paper if variant == "memory_paper" else mt.MemoryCell
    options = {"n_slots": cfg.n_slots, "output_size": out, **CELLS[variant]}
    return make(n_inputs, size, **options)


class Memory(nn.Module):
    """Outputs (T, B, O) of x (T, B, I)."""

    def __init__(self, cell: mt.MemoryCell) -> None:
        super().__init__()
        self.sequence = mt.MemorySequence(cell)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """No step is taken where `valid` (T, B) is False."""
        return self.sequence(x, valid=valid)[0]
