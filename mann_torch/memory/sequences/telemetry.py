"""What a memory did, as arrays: attention, contents, reallocations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...checks import instance, whole
from ...errors import ShapeError
from ...trees import map_tensors
from ..cells.cell_state import Attended, CellState


class MemoryTrace(NamedTuple):
    """A memory's signals over T steps, time first."""

    read: Tensor  # (T, ..., N) h_o
    weights: Tensor  # (T, ..., S) w_r
    mu: Tensor  # (T, ..., S, N) contents after the step
    keys: Tensor  # (T, ..., S, D) keys after the step
    active: Tensor  # (T, ..., S) slots in use
    attended: Tensor  # (T, ...) slot with the largest weight
    switches: Tensor  # (T, ...) changes of it so far
    reallocations: Tensor  # (T, ...) resets so far
    reset: Tensor  # (T, ...) int64, slot that was reset in this step; -1: none
    valid: Tensor  # (T, ...) bool, False: no step was taken, nothing attended, all stood still

    @classmethod
    def row(
        cls, before: CellState, seen: Attended, after: CellState, valid: Tensor | None = None
    ) -> MemoryTrace:
        """One step's signals, detached: `seen = cell.attend(x, before)`, then `cell.write`.

        `valid` (...,) bool says whose step it is; None: everybody's.
        """
        taken = torch.ones_like(after.attended, dtype=torch.bool) if valid is None else valid
        read, weights = (torch.where(taken.unsqueeze(-1), x, 0.0) for x in seen[:2])
        row = cls(
            read,
            weights,
            after.mu,
            after.keys,
            after.active,
            after.attended,
            after.switches,
            after.reallocations,
            torch.where(taken, _reset_slot(before, seen.state), -1),
            taken,
        )
        return map_tensors(Tensor.detach, row)

    @classmethod
    def stack(cls, rows: Sequence[MemoryTrace]) -> MemoryTrace:
        """Steps put one after the other."""
        return cls(*(torch.stack(leaves) for leaves in zip(*rows, strict=True)))

    def member(self, *index: int) -> dict[str, np.ndarray]:
        """One batch member's signals as arrays (T, .), by name; no index where there is no batch.

        Raises `ShapeError` for an index that names no single member.

        >>> from mann_torch.memory import MemoryCell, MemorySequence
        >>> trace = MemorySequence(MemoryCell(3, 8, n_slots=4)).trace(torch.zeros(7, 2, 3))
        >>> trace.member(1)["mu"].shape
        (7, 4, 8)
        """
        index = tuple(whole("index", i, least=None) for i in index)
        batch = self.attended.shape[1:]
        if len(index) != len(batch):
            raise ShapeError(f"member {index} of a batch of {tuple(batch)}: give one index each")
        if any(not -n <= i < n for i, n in zip(index, batch, strict=True)):
            raise ShapeError(f"member {index} of a batch of {tuple(batch)}: out of range")
        where = (slice(None), *index)
        return {name: leaf[where].cpu().numpy() for name, leaf in self._asdict().items()}


def reallocation_log(trace: MemoryTrace, *index: int) -> dict[str, np.ndarray]:
    """Steps and slots at which one batch member's slots were reset: `step` (K,), `slot` (K,)."""
    reset = instance("trace", trace, MemoryTrace).member(*index)["reset"]
    step = np.flatnonzero(reset >= 0)
    return {"step": step, "slot": reset[step]}


def _reset_slot(before: CellState, jumped: CellState) -> Tensor:
    """The slot (...,) that a jump changed, where it counted a reset; else -1.

    Under relaxed attention, which moves all a little, the one that it changed most.
    """
    moved = (jumped.mu - before.mu).abs().amax(dim=-1)
    entered = jumped.active.to(moved.dtype) - before.active.to(moved.dtype)
    slot = (moved + entered).argmax(dim=-1)
    return torch.where(jumped.reallocations > before.reallocations, slot, -1)
