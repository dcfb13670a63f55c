"""Which slot is written: the attended ones, or the next in turn."""

from __future__ import annotations

import torch
from torch import Tensor

#: ``attended``: the slots that are read, as in the paper; ``next``: one after the other.
WRITINGS = ("attended", "next")
#: A share of a slot, written in one step, beyond which the next step goes to the next slot.
WRITTEN = 0.5


def moved_on(slot: Tensor, share: Tensor, n_slots: int) -> Tensor:
    """The slot (...,) to be written after one whose share (...,) was written."""
    return torch.where(share > WRITTEN, (slot + 1) % n_slots, slot)
