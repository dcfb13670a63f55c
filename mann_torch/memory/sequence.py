"""A cell over a sequence, as `nn.LSTM` is over `nn.LSTMCell`."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..checks import flag, instance
from ..errors import ShapeError
from .cell import MemoryCell
from .cell_state import CellState
from .checks import check_tensor
from .telemetry import MemoryTrace


class MemorySequence(nn.Module):
    """`outputs, state = sequence(x)` over a whole sequence.

    x is (T, ..., I), or (B, T, I) with `batch_first`, as in `nn.LSTM`; outputs likewise. Raises
    `KindError` for what is no `MemoryCell`.

    >>> sequence = MemorySequence(MemoryCell(3, 8), batch_first=True)
    >>> outputs, state = sequence(torch.zeros(2, 50, 3))
    >>> outputs.shape
    torch.Size([2, 50, 8])
    """

    def __init__(self, cell: MemoryCell, batch_first: bool = False) -> None:
        super().__init__()
        self.cell = instance("cell", cell, MemoryCell)
        self.batch_first = flag("batch_first", batch_first)

    def forward(
        self, x: Tensor, state: CellState | None = None, dt: Tensor | None = None
    ) -> tuple[Tensor, CellState]:
        """Outputs of every step and the last state; starts from `initial_state` if none is given.

        `dt` (T, ...), or (B, T) with `batch_first`, gives every step its own length, (T,) the same
        for all: samples at uneven times, or 0 where nothing is to be written. Raises `ShapeError`
        for a sequence without a step.
        """
        steps, state = self._begin(x, state, dt)
        outputs = []
        for now, span in steps:
            output, state = self.cell(now, state, dt=span)
            outputs.append(output)
        return torch.stack(outputs, dim=1 if self._swaps(x) else 0), state

    @torch.no_grad()
    def trace(
        self, x: Tensor, state: CellState | None = None, dt: Tensor | None = None
    ) -> MemoryTrace:
        """What the memory did at every step, time first (T, ...): for telemetry, no gradients."""
        steps, state = self._begin(x, state, dt)
        rows = []
        for now, span in steps:
            seen = self.cell.attend(now, state, span)
            after = self.cell.write(seen)
            rows.append(MemoryTrace.row(state, seen, after))
            state = after
        return MemoryTrace.stack(rows)

    def _swaps(self, x: Tensor) -> bool:
        return self.batch_first and x.dim() > 2  # as nn.LSTM: (T, I) has no batch

    def _begin(
        self, x: Tensor, state: CellState | None, dt: Tensor | None
    ) -> tuple[list[tuple[Tensor, Tensor | None]], CellState]:
        """Each step's x and dt, and the state before the first."""
        check_tensor("x", x, (self.cell.input_size,), None)
        if x.dim() < 2:
            raise ShapeError(f"x has shape {tuple(x.shape)}; a sequence is (T, ..., I)")
        x = x.transpose(0, 1) if self._swaps(x) else x
        if len(x) == 0:
            raise ShapeError("a sequence needs at least one step")
        state = self.cell.initial_state(x.shape[1:-1]) if state is None else state
        if dt is None:
            return [(now, None) for now in x.unbind(0)], state
        instance("dt", dt, Tensor)
        spans = dt.transpose(0, 1) if self.batch_first and dt.dim() > 1 else dt
        if spans.shape[:1] != x.shape[:1]:
            form = "(B, T)" if self.batch_first else "(T, ...)"
            raise ShapeError(f"dt has shape {tuple(dt.shape)}; a sequence of {len(x)} has {form}")
        return list(zip(x.unbind(0), spans.unbind(0), strict=True)), state
