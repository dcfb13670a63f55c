"""Cells in layers and in both directions, with the manners of `nn.LSTM`."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import PackedSequence

from ...checks import flag, instance, number, whole
from ...errors import ConfigError, DomainError, ShapeError
from ..cells.cell import MemoryCell
from ..cells.cell_state import CellState
from .lengths import Lengths, Padded, both, valid_steps
from .sequence import MemorySequence

#: States of all cells: layer by layer, in each the forward direction first.
States = tuple[CellState, ...]


class MemoryLayers(nn.Module):
    """`outputs, states = layers(x)`: a stack of `MemoryCell`s over a sequence, as `nn.LSTM` is.

    x is (T, ..., I), or (B, T, I) with `batch_first`, or a `PackedSequence`; outputs likewise, of
    the last layer. `dropout` is the share of outputs of each layer but the last that are dropped in
    training; `bidirectional` adds cells that go through every sequence from its own end, and puts
    their outputs beside the others'. `states` holds a `CellState` a cell, in the order of `cells`;
    with `return_state=False` outputs come alone, for `nn.Sequential`. `options` are
    `MemoryCell`'s; every cell has copies of the parts among them.

    Raises `ConfigError`, `DomainError`, and what `MemoryCell` raises.

    >>> layers = MemoryLayers(3, 8, num_layers=2, batch_first=True, bidirectional=True)
    >>> outputs, states = layers(torch.zeros(2, 5, 3), lengths=[5, 3])
    >>> outputs.shape, len(states)
    (torch.Size([2, 5, 16]), 4)
    """

    def __init__(
        self,
        input_size: int,
        hidden_size: int,
        num_layers: int = 1,
        *,
        batch_first: bool = False,
        dropout: float = 0.0,
        bidirectional: bool = False,
        return_state: bool = True,
        engine: str = "auto",
        **options: Any,
    ) -> None:
        super().__init__()
        self.input_size = width = whole("input_size", input_size)
        self.hidden_size = whole("hidden_size", hidden_size)
        self.num_layers = whole("num_layers", num_layers)
        self.dropout = number("dropout", dropout)
        if not 0.0 <= self.dropout < 1.0:
            raise DomainError(f"dropout = {dropout}: must be in [0, 1)")
        self.bidirectional = flag("bidirectional", bidirectional)
        self.batch_first = flag("batch_first", batch_first)
        self.return_state = flag("return_state", return_state)
        if options.get("features") is not None and self.num_layers > 1:
            raise ConfigError("features are of one input's size: give each layer a MemoryCell")
        self.directions = 2 if self.bidirectional else 1
        out = options.get("output_size")
        self.sequences = nn.ModuleList()
        for _ in range(self.num_layers):
            for _ in range(self.directions):
                parts = {name: copy.deepcopy(value) for name, value in options.items()}
                cell = MemoryCell(width, self.hidden_size, **parts)
                self.sequences.append(MemorySequence(cell, engine=engine))
            width = self.directions * (self.hidden_size if out is None else out)

    @property
    def cells(self) -> list[MemoryCell]:
        """Layer by layer, in each the forward direction first."""
        return [instance("sequence", s, MemorySequence).cell for s in self.sequences]

    def initial_state(self, batch_shape: Sequence[int] | int = ()) -> States:
        """States before the first step, one a cell. Raises as the cell's."""
        return tuple(cell.initial_state(batch_shape) for cell in self.cells)

    def forward(
        self,
        x: Tensor | PackedSequence,
        state: Sequence[CellState] | None = None,
        dt: Tensor | None = None,
        *,
        lengths: Lengths | None = None,
        reset: Tensor | None = None,
        valid: Tensor | None = None,
    ) -> Any:
        """Outputs and the last states, or outputs alone without `return_state`.

        `dt`, `lengths`, `reset` and `valid` as in `MemorySequence`, for every layer. Raises as it,
        and `ConfigError` for a `reset` where cells go both ways: an episode's first step is not its
        last one's.
        """
        padded = Padded.of(x, lengths) if isinstance(x, PackedSequence) else None
        swaps = padded is None and self.batch_first and isinstance(x, Tensor) and x.dim() > 2
        steps = padded.x if padded is not None else instance("x", x, Tensor)
        if padded is not None:
            lengths = padded.lengths
        given_marks = (("dt", dt), ("reset", reset), ("valid", valid))
        marks = [None if mark is None else instance(n, mark, Tensor) for n, mark in given_marks]
        if swaps:
            steps = steps.transpose(0, 1)
            marks = [m.transpose(0, 1) if m is not None and m.dim() > 1 else m for m in marks]
        dt, reset, valid = marks
        if steps.dim() < 2:
            raise ShapeError(f"x has shape {tuple(steps.shape)}; a sequence is (T, ..., I)")
        if reset is not None and self.bidirectional:
            raise ConfigError("reset: cells that go both ways have no step before the first")
        if lengths is not None:
            within = valid_steps(lengths, len(steps), steps.shape[1:-1], steps.device)
            valid = both(valid, within)
        given = self._states(state)
        last: list[CellState] = []
        for layer in range(self.num_layers):
            outputs = []
            for direction in range(self.directions):
                index = layer * self.directions + direction
                found, after = self._one(index, steps, given[index], dt, reset, valid)
                outputs.append(found)
                last.append(after)
            steps = torch.cat(outputs, dim=-1)
            if layer + 1 < self.num_layers:
                steps = nn.functional.dropout(steps, self.dropout, self.training)
        found_x: Any = steps.transpose(0, 1) if swaps else steps
        if padded is not None:
            found_x = padded.packed(steps)
        return (found_x, tuple(last)) if self.return_state else found_x

    def _one(
        self,
        index: int,
        x: Tensor,
        state: CellState | None,
        dt: Tensor | None,
        reset: Tensor | None,
        valid: Tensor | None,
    ) -> tuple[Tensor, CellState]:
        """One cell over the sequence; backwards, what is not valid comes first and is skipped."""
        sequence = self.sequences[index]
        if index % self.directions == 0:
            outputs, after = sequence(x, state, dt, reset=reset, valid=valid)
            return outputs, after
        turned = [None if m is None else m.flip(0) for m in (dt, valid)]
        outputs, after = sequence(x.flip(0), state, turned[0], valid=turned[1])
        return outputs.flip(0), after

    def _states(self, state: Sequence[CellState] | None) -> Sequence[CellState | None]:
        if state is None:
            return [None] * len(self.sequences)
        count = len(self.sequences)
        listed = isinstance(state, list | tuple) and not isinstance(state, CellState)
        if not listed or len(state) != count:
            raise ConfigError(f"state: {count} of CellState are wanted, one a cell")
        return state

    def extra_repr(self) -> str:
        """What there is besides the cells."""
        return (
            f"num_layers={self.num_layers}, bidirectional={self.bidirectional}, "
            f"dropout={self.dropout}, batch_first={self.batch_first}"
        )
