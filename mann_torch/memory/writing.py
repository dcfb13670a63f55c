"""Which slot is written: the attended ones, or the next in turn."""

from __future__ import annotations

import torch
from torch import Tensor

from ..functional import one_hot

#: ``attended``: the slots that are read, as in the paper; ``next``: one after the other.
WRITINGS = ("attended", "next")
#: A share of a slot, written in one step, beyond which the next step goes to the next slot.
WRITTEN = 0.5


def moved_on(slot: Tensor, share: Tensor, n_slots: int) -> Tensor:
    """The slot (...,) to be written after one whose share (...,) was written."""
    return torch.where(share > WRITTEN, (slot + 1) % n_slots, slot)


def by_age(values: Tensor, slot: Tensor) -> Tensor:
    """Values (S,) of ages as those of slots (..., S), where `slot` (...,) is the next in turn.

    The slot written last has age 0, the one to be written next S - 1.
    """
    n_slots = values.shape[-1]
    each = torch.arange(n_slots, device=slot.device)
    age = (slot.unsqueeze(-1) - 1 - each) % n_slots
    return (one_hot(age, n_slots).to(values.dtype) * values).sum(dim=-1)
