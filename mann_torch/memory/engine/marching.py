"""A cell's steps over a sequence, marched by the compiled engine.

What a step makes of x alone is there before (`MemoryCell.look`): a row of segments a step. What is
traced is `stepped`, of one sample.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ...compiled import (
    Arguments,
    Fingerprint,
    Rows,
    check_agreement,
    frozen,
    job_of,
    march,
    program_of,
    with_tensors,
)
from ..cells.cell import MemoryCell
from ..cells.cell_state import CellState, Looked
from ..sequences.steps import Marks, stepped
from .held import Held


class SequenceStep:
    """A step of one sample: (looked and marks, state) -> (read, state)."""

    def __init__(self, cell: MemoryCell, names: Sequence[str], marks: Marks) -> None:
        self._cell, self._names = frozen(cell), names
        self._marked = [leaf is not None for leaf in marks]

    def __call__(self, given: Arguments) -> list[Tensor]:
        """The next carry."""
        count = len(Looked._fields)
        marked = iter(given.segments[count:])
        marks = Marks(*(next(marked) > 0.5 if there else None for there in self._marked))
        looked, state = Looked(*given.segments[:count]), CellState(*given.carry[1:])
        with with_tensors(self._cell, dict(zip(self._names, given.constants, strict=True))):
            _, seen, after = stepped(self._cell, looked, state, marks)
            return [seen.read, *after]


def run(
    cell: MemoryCell, looked: Looked, state: CellState, marks: Marks
) -> tuple[Tensor, Tensor, CellState]:
    """Features and reads (T, *batch, N), and the last state.

    Raises `UntraceableError`, `KernelError`.

    `looked` (T, *batch, ...), `state` (*batch, ...) and `marks` (T, *batch) have one batch shape.
    """
    batch, device = state.attended.shape, looked.hidden.device
    B, T, depth = batch.numel(), len(looked.hidden), len(batch)
    segments = [leaf.reshape((T, B, *leaf.shape[1 + depth :])) for leaf in looked]
    segments += [leaf.reshape(T, B).to(cell.dtype) for leaf in marks if leaf is not None]
    read = torch.zeros_like(looked.hidden[0]).detach()
    N = read.shape[-1]
    carry = [leaf.reshape((B, *leaf.shape[depth:])) for leaf in (read, *state)]
    held = Held.of(cell, cell.stepped)
    rows = Rows(held.rows(batch), segments, carry)
    prints = Fingerprint()
    # Of the whole cell: options that have no part of their own decide in a step too.
    key = (SequenceStep, prints.of(cell), tuple(m is None for m in marks))
    shown = 1 if cell.inertia is None else 2  # the read, and features that have a state
    program = program_of(key, prints, lambda: SequenceStep(cell, held.names, marks), rows, shown)
    job, tensors = job_of(program, rows)
    backward = torch.is_grad_enabled() and any(t.requires_grad for t in tensors)
    check_agreement(program, job.lanes_used, job.wanted if backward else None)
    found = march(job, *tensors)
    last = program.layout.carried(found.state_f[0], found.last_k, tuple(batch))[1:]
    motion = found.motion.reshape((T, *batch, -1)).to(device)
    reads, *own = motion.split(N, dim=-1)
    hidden = own[0] if own else looked.hidden
    return hidden, reads, CellState(*(leaf.to(device) for leaf in last))
