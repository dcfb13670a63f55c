"""A cell over a sequence, as `nn.LSTM` is over `nn.LSTMCell`."""

from __future__ import annotations

import logging
from typing import Any, NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import PackedSequence

from ...checks import choice, flag, instance
from ...errors import ConfigError, DtypeError, KernelError, ShapeError
from ..cells.cell import MemoryCell
from ..cells.cell_state import LOOKED_RANKS, RANKS, CellState, Looked
from ..checks import check_tensor, check_within, common_batch, exactly
from .lengths import Lengths, Padded, both, valid_steps
from .steps import Marks, stepped
from .telemetry import MemoryTrace

log = logging.getLogger("mann_torch")
ENGINES = ("auto", "compiled", "torch")
CELL = "a MemoryCell, as in MemorySequence(MemoryCell(3, 8)); MemoryLayers(3, 8) takes sizes"


class Taken(NamedTuple):
    """Which engine takes a sequence, and why."""

    engine: str  # "compiled" or "torch"
    reason: str


class _Begun(NamedTuple):
    """A sequence, checked, time first."""

    looked: Looked  # (T, *batch, ...)
    state: CellState  # (*batch, ...)
    marks: Marks  # (T, *batch)


class _Run(NamedTuple):
    """What an engine gives."""

    hidden: Tensor  # (T, *batch, N)
    read: Tensor  # (T, *batch, N)
    last: CellState
    taken: Taken


class MemorySequence(nn.Module):
    """`outputs, state = sequence(x)` over a whole sequence.

    x is (T, ..., I), or (B, T, I) with `batch_first`, as in `nn.LSTM`; outputs likewise. Raises
    `KindError` for what is no `MemoryCell`.

    `engine`: ``auto`` marches the steps on the compiled engine and takes torch where that can't be
    (`taken` says which, and why); ``compiled`` refuses instead; ``torch`` steps in eager torch.

    >>> sequence = MemorySequence(MemoryCell(3, 8), batch_first=True)
    >>> outputs, state = sequence(torch.zeros(2, 50, 3))
    >>> outputs.shape
    torch.Size([2, 50, 8])
    """

    def __init__(self, cell: MemoryCell, batch_first: bool = False, engine: str = "auto") -> None:
        super().__init__()
        self.cell = instance("cell", cell, MemoryCell, CELL)
        self.batch_first = flag("batch_first", batch_first)
        self.engine = choice("engine", engine, ENGINES)

    def forward(
        self,
        x: Tensor | PackedSequence,
        state: CellState | None = None,
        dt: Tensor | None = None,
        *,
        lengths: Lengths | None = None,
        reset: Tensor | None = None,
        valid: Tensor | None = None,
    ) -> tuple[Any, CellState]:
        """Outputs of every step and the last state; starts from `initial_state` if none is given.

        x may be a `PackedSequence`: outputs are one too then, as of `nn.LSTM`. `lengths` (B,) are
        those of padded sequences: no step is taken beyond.

        `dt`, `reset` and `valid` are (T, ...), or (B, T) with `batch_first` (not of packed ones),
        or (T,) for all alike. `dt` gives every step its own length: samples at uneven times, or 0
        where nothing is to be written. Where `reset` (bool) is True the state begins anew before
        the step: an episode's first. Where `valid` (bool) is False no step is taken: the state
        stays, bit for bit, and the output is 0.

        Raises `ShapeError`, `DtypeError`, for a sequence without a step too, and `ConfigError` or
        `KernelError` where the compiled engine is asked for and can't take it.
        """
        if isinstance(x, PackedSequence):
            padded = Padded.of(x, lengths)
            own = MemorySequence(self.cell, engine=self.engine)
            outputs, last = own(
                padded.x, state, dt, lengths=padded.lengths, reset=reset, valid=valid
            )
            return padded.packed(outputs), last
        begun = self._begin(x, state, dt, reset, valid, lengths)
        hidden, reads, last, _ = self._run(begun)
        outputs = self.cell.shown(hidden, reads)
        if begun.marks.valid is not None:
            outputs = torch.where(begun.marks.valid.unsqueeze(-1), outputs, 0.0)
        return outputs.transpose(0, 1) if self._swaps(x) else outputs, last

    def taken(self, x: Tensor) -> Taken:
        """Which engine takes x, and why; it is traced, compiled and run to see."""
        return self._run(self._begin(x, None, None, None, None)).taken

    def _run(self, begun: _Begun) -> _Run:
        if self.engine == "torch":
            return self._eager(begun, "engine='torch'")
        if torch.compiler.is_dynamo_compiling() and not torch.compiler.is_exporting():
            # Written out, hundreds of steps take torch.compile minutes.
            from ..engine.apart import apart

            return cast(_Run, apart(self._run_now, begun))
        return self._run_now(begun)

    def _run_now(self, begun: _Begun) -> _Run:
        from ...compiled import UntraceableError
        from ..engine import marching
        from ..engine.held import obstacle

        reason = obstacle(self.cell, self.cell.stepped, begun.looked.hidden.device)
        if reason is None and begun.state.attended.numel() == 0:
            return self._eager(begun, "there is no sample to compile a step for")
        if reason is None:
            try:
                with exactly(begun.looked.hidden.device):
                    found = marching.run(self.cell, *begun)
                return _Run(*found, Taken("compiled", "the step was traced and compiled"))
            except (UntraceableError, KernelError) as error:
                if self.engine == "compiled" and isinstance(error, KernelError):
                    raise
                reason = str(error)
        if self.engine == "compiled":
            raise ConfigError(f"engine = 'compiled': {reason}")
        return self._eager(begun, reason)

    def _eager(self, begun: _Begun, reason: str) -> _Run:
        state, rows = begun.state, []
        for step in range(len(begun.looked.hidden)):
            now = Looked(*(leaf[step] for leaf in begun.looked))
            _, seen, state = stepped(self.cell, now, state, begun.marks.at(step))
            rows.append((seen.hidden, seen.read))
        hidden, reads = (torch.stack(column) for column in zip(*rows, strict=True))
        return _Run(hidden, reads, state, Taken("torch", reason))

    @torch.no_grad()
    def trace(
        self,
        x: Tensor | PackedSequence,
        state: CellState | None = None,
        dt: Tensor | None = None,
        *,
        lengths: Lengths | None = None,
        reset: Tensor | None = None,
        valid: Tensor | None = None,
    ) -> MemoryTrace:
        """What the memory did at every step, time first (T, ...): for telemetry, no gradients.

        Takes and raises what a call does. Where no step was taken its `valid` is False.
        """
        if isinstance(x, PackedSequence):
            x, lengths, _ = Padded.of(x, lengths)
            own = MemorySequence(self.cell)
            return own.trace(x, state, dt, lengths=lengths, reset=reset, valid=valid)
        begun = self._begin(x, state, dt, reset, valid, lengths)
        rows, after = [], begun.state
        for step in range(len(begun.looked.hidden)):  # in torch: all of it is to be kept
            looked, marks = Looked(*(leaf[step] for leaf in begun.looked)), begun.marks.at(step)
            before, seen, after = stepped(self.cell, looked, after, marks)
            rows.append(MemoryTrace.row(before, seen, after, marks.valid))
        return MemoryTrace.stack(rows)

    def _swaps(self, x: Tensor) -> bool:
        return self.batch_first and x.dim() > 2  # as nn.LSTM: (T, I) has no batch

    def _begin(
        self,
        x: Tensor,
        state: CellState | None,
        dt: Tensor | None,
        reset: Tensor | None,
        valid: Tensor | None,
        lengths: Lengths | None = None,
    ) -> _Begun:
        cell = self.cell
        check_tensor("x", x, (cell.input_size,), None)
        if x.dim() < 2:
            raise ShapeError(f"x has shape {tuple(x.shape)}; a sequence is (T, ..., I)")
        x = x.transpose(0, 1) if self._swaps(x) else x
        if len(x) == 0:
            raise ShapeError("a sequence needs at least one step")
        state = cell.initial_state(x.shape[1:-1]) if state is None else state
        shapes = {"x": tuple(x.shape[1:-1]), "state": cell.check_state(state)}
        batch = common_batch({**shapes, "constants": tuple(cell.batch_shape())})
        missing = len(batch) - (x.dim() - 2)  # fewer dimensions mean the same for all
        x = x.reshape(len(x), *(1 for _ in range(missing)), *x.shape[1:])
        spans = self._per_step("dt", dt, x, batch)
        spans = None if spans is None else spans.to(cell.dtype)
        shape, marks = (len(x), *batch), []
        for name, mark in (("reset", reset), ("valid", valid)):
            if mark is not None and instance(name, mark, Tensor).dtype != torch.bool:
                raise DtypeError(f"{name} is {mark.dtype}: it is a mask of bool")
            found = self._per_step(name, mark, x, batch)
            marks.append(found)
        if lengths is not None:
            marks[1] = both(marks[1], valid_steps(lengths, len(x), batch, x.device))
        if (taken := marks[1]) is not None:  # padding may be NaN, and 0 times NaN is no slope
            x = torch.where(taken.unsqueeze(-1), x, 0.0)
            spans = None if spans is None else torch.where(taken, spans, 1.0)
        looked = cell.look(x, spans)
        return _Begun(
            Looked(
                *(
                    leaf.expand((*shape, *leaf.shape[leaf.dim() - rank :]))
                    for leaf, rank in zip(looked, LOOKED_RANKS, strict=True)
                )
            ),
            CellState(
                *(
                    leaf.expand((*batch, *leaf.shape[leaf.dim() - rank :]))
                    for leaf, rank in zip(state, RANKS, strict=True)
                )
            ),
            Marks(*(None if mark is None else mark.expand(shape) for mark in marks)),
        )

    def _per_step(
        self, name: str, given: Tensor | None, x: Tensor, batch: tuple[int, ...]
    ) -> Tensor | None:
        """A number a step and sample (T, ...) of what was given in the caller's order."""
        if given is None:
            return None
        found = instance(name, given, Tensor)
        found = found.transpose(0, 1) if self.batch_first and found.dim() > 1 else found
        if found.shape[:1] != x.shape[:1]:
            form = "(B, T)" if self.batch_first else "(T, ...)"
            raise ShapeError(
                f"{name} has shape {tuple(given.shape)}; a sequence of {len(x)} has {form}"
            )
        check_within(name, tuple(found.shape[1:]), batch)
        missing = len(batch) + 1 - found.dim()  # fewer dimensions mean the same for all
        return found.reshape(len(x), *(1 for _ in range(missing)), *found.shape[1:])
