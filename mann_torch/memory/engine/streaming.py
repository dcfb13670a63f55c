"""Single steps of a cell on the compiled engine: what `MemoryStream` calls."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import torch
from torch import Tensor

from ...compiled import (
    Arguments,
    Fingerprint,
    Rows,
    Single,
    UntraceableError,
    check_agreement,
    frozen,
    job_of,
    program_of,
    with_tensors,
)
from ...errors import DtypeError
from ..cells.cell import MemoryCell
from ..cells.cell_state import CellState
from ..checks import check_within
from .held import Held, obstacle


class StreamStep:
    """A whole step of one sample: (x and dt, state) -> (output, state)."""

    def __init__(self, cell: MemoryCell, names: Sequence[str]) -> None:
        self._cell, self._names = frozen(cell), names

    def __call__(self, given: Arguments) -> list[Tensor]:
        """The next carry."""
        cell = self._cell
        with with_tensors(cell, dict(zip(self._names, given.constants, strict=True))):
            looked = cell.look(*given.segments)
            seen, state = cell.seen(looked, CellState(*given.carry[1:]))
            return [cell.output_of(seen), *state]


class Streamed:
    """Steps of one cell for one batch shape. Raises `UntraceableError`, `KernelError`."""

    def __init__(self, cell: MemoryCell, batch: torch.Size) -> None:
        parts = [name for name, _ in cell.named_children()]
        refusal = obstacle(cell, parts, cell.slots.device)
        if refusal is None and cell.slots.device.type != "cpu":
            refusal = f"single steps are compiled for the CPU, not for {cell.slots.device.type}"
        if refusal is not None:
            raise UntraceableError(refusal)
        self._cell, self._batch, self._lock = cell, batch, threading.Lock()
        self._held = Held.of(cell, parts)
        with torch.no_grad():
            rows, prints = self._rows(), Fingerprint()
            names = self._held.names
            key = (StreamStep, type(cell), prints.of(cell))
            program = program_of(key, prints, lambda: StreamStep(cell, names), rows)
            job, tensors = job_of(program, rows)
            check_agreement(program, job.lanes_used)
            self._single = Single(job, *tensors)
        self._program, self._n_out = program, rows.carry[0].shape[1]
        self._x, self._dt = self._single.segments.split([cell.input_size, 1], dim=-1)
        self.size = self._single.size
        self._known, self._out = self._versions(), (*batch, self._n_out)

    def _rows(self) -> Rows:
        cell, B = self._cell, self._batch.numel()
        x = torch.zeros(1, B, cell.input_size, dtype=cell.dtype)
        state = cell.initial_state(self._batch)
        hidden = torch.zeros(B, cell.hidden_size, dtype=cell.dtype)
        carry = [x.reshape((B, *x.shape[len(self._batch) :])) for x in state]
        return Rows(
            self._held.rows(self._batch),
            [x, self._span()[None]],
            [cell.shown(hidden, hidden), *carry],
        )

    def _span(self) -> Tensor:
        return self._cell.dt.detach().expand(self._batch).reshape(-1).clone()

    def _versions(self) -> list[tuple[int, int]]:
        return [(t._version, t.data_ptr()) for t in self._held.tensors]

    def __call__(
        self, x: Tensor, state: Tensor, dt: Tensor | float | None
    ) -> tuple[Tensor, Tensor]:
        """Output (*batch, M) and the next state."""
        if x.requires_grad or state.requires_grad:
            x, state = x.detach(), state.detach()
        with self._lock:
            if self._versions() != self._known:
                self._take_up()
            self._x.copy_(x.reshape(self._x.shape))
            if dt is not None:
                self._dt.copy_(self._span_of(dt))
            after = self._single(state)
            if dt is not None:
                self._dt.copy_(self._span().unsqueeze(-1))
        output = self._single.first(after, self._n_out)
        return output.reshape(self._out), after

    @torch.no_grad()
    def _take_up(self) -> None:
        """Parameters that have changed since."""
        rows = self._rows()
        tensors = job_of(self._program, rows)[1]
        self._single.renew(*tensors)
        self._dt.copy_(self._span().unsqueeze(-1))
        self._known = self._versions()

    def _span_of(self, dt: Tensor | float) -> Tensor:
        if isinstance(dt, Tensor) and dt.dtype != self._cell.dtype:
            raise DtypeError(f"dt is {dt.dtype}, this stream takes {self._cell.dtype}: convert dt")
        given = torch.as_tensor(dt, dtype=self._cell.dtype).detach()
        check_within("dt", tuple(given.shape), tuple(self._batch))
        return given.expand(self._batch).reshape(-1, 1)

    def packed(self, state: CellState) -> Tensor:
        """A cell's state as one flat tensor."""
        B = self._batch.numel()
        leaves = [leaf.detach().reshape(B, -1) for leaf in state]
        f = [torch.zeros(B, self._n_out, dtype=self._cell.dtype)]
        f += [leaf for leaf in leaves if leaf.is_floating_point()]
        k = [-x.long() if x.dtype == torch.bool else x for x in leaves if not x.is_floating_point()]
        return self._single.packed(torch.cat(f, dim=-1), torch.cat(k, dim=-1))

    def unpacked(self, state: Tensor) -> CellState:
        """The inverse of `packed`."""
        f, k = self._single.unpacked(state)
        return CellState(*self._program.layout.carried(f, k, tuple(self._batch))[1:])
