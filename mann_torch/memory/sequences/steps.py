"""One step of a sequence: a cell's step, with what may begin anew or be over before it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ...functional import pick
from ...trees import map_tensors
from ..cells.cell import MemoryCell
from ..cells.cell_state import Attended, CellState, Looked


class Marks(NamedTuple):
    """What is marked at a step; None: nowhere."""

    reset: Tensor | None = None  # (...,) bool, the state begins anew before the step
    valid: Tensor | None = None  # (...,) bool, False: no step is taken, the output is 0

    def at(self, step: int) -> Marks:
        """Those of one step, of marks (T, ...)."""
        return Marks(*(None if leaf is None else leaf[step] for leaf in self))


def stepped(
    cell: MemoryCell, looked: Looked, state: CellState, marks: Marks
) -> tuple[CellState, Attended, CellState]:
    """The state it starts from, what it sees, and the next: the step that every engine takes."""
    if marks.reset is not None:
        state = begun(cell, state, marks.reset)
    seen, after = cell.seen(looked, state)
    if marks.valid is not None:
        valid = marks.valid
        after = map_tensors(lambda new, old: pick(valid, new, old), after, state)
        seen = seen._replace(read=torch.where(valid.unsqueeze(-1), seen.read, 0.0))
    return state, seen, after


def begun(cell: MemoryCell, state: CellState, reset: Tensor) -> CellState:
    """`initial_state` where `reset` (...,) says so, the state elsewhere."""
    fresh = cell.initial_state(state.attended.shape)
    return map_tensors(lambda new, old: pick(reset, new, old), fresh, state)
