"""A cell's tensors and steps as the compiled engine (`mann_torch.compiled`) takes them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...compiled import (
    Fingerprint,
    Job,
    Layout,
    Leaf,
    Program,
    UntraceableError,
    missing,
    transformed,
)
from ...constraints import DesignModule
from ..cells.cell import MemoryCell

#: Programs of this process by what they depend on, or why there is none.
_PROGRAMS: dict[Hashable, tuple[Program | UntraceableError, list[Any]]] = {}
_LOCK = threading.RLock()
_MOST = 64
_DTYPES = (torch.float32, torch.float64)
#: Bytes of checkpoints beyond which they are farther apart.
_TAPE = 2e9


def obstacle(cell: MemoryCell, parts: Sequence[str], device: torch.device) -> str | None:
    """Why steps through these parts can't even be tried, in a few words; None if they can."""
    if torch.compiler.is_compiling():
        return "torch.compile and torch.export take the steps themselves"
    if cell.dtype not in _DTYPES:
        return f"the compiled engine computes in float32 and float64, not {cell.dtype}"
    if device.type not in ("cpu", "cuda"):
        return f"there is no compiled engine on {device.type}"
    traced = (m for name in parts for m in cell.get_submodule(name).modules())
    if any(m._forward_hooks or m._forward_pre_hooks for m in traced):
        return "forward hooks are not called by the compiled engine"
    if transformed():
        return "torch.func and forward-mode differentiation need the torch engine"
    return missing()


class Held(NamedTuple):
    """The tensors of a cell that its steps may read, by dotted name."""

    names: list[str]
    tensors: list[Tensor]
    events: list[int]  # trailing dimensions of one sample's value

    @classmethod
    def of(cls, cell: MemoryCell, parts: Sequence[str]) -> Held:
        """Those of some parts of the cell, and what a run starts from."""
        found: dict[str, Tensor] = {**dict(cell.named_parameters(recurse=False)), "dt": cell.dt}
        events: dict[str, int] = {"dt": 0}
        for name in parts:
            part = cell.get_submodule(name)
            found |= {f"{name}.{n}": t for n, t in part.named_parameters()}
            found |= {f"{name}.{n}": t for n, t in part.named_buffers()}
            for prefix, inner in part.named_modules(prefix=name):
                if isinstance(inner, DesignModule):
                    for own, domain in inner.domains().items():
                        found[f"{prefix}.{own}"] = getattr(inner, own)
                        events[f"{prefix}.{own}"] = domain.event_dims
        return cls(
            list(found), list(found.values()), [events.get(n, t.dim()) for n, t in found.items()]
        )

    def rows(self, batch: torch.Size) -> list[Row]:
        """Each as it is where it is for all samples, else (B, *event)."""
        return [_row(t, e, batch) for t, e in zip(self.tensors, self.events, strict=True)]


class Row(NamedTuple):
    """A constant: one value for all samples, (*event), or one each, (B, *event)."""

    value: Tensor
    shared: bool

    def one(self) -> Tensor:
        """As one sample has it."""
        return self.value if self.shared else self.value[0]


def _row(x: Tensor, event_dims: int, batch: torch.Size) -> Row:
    if x.is_floating_point() and x.dim() == event_dims:
        return Row(x, True)
    event = x.shape[x.dim() - event_dims :]
    return Row(x.expand((*batch, *event)).reshape((batch.numel(), *event)), False)


class Rows(NamedTuple):
    """What a march takes, a row a sample."""

    constants: list[Row]
    segments: list[Tensor]  # each (T, B, *event)
    carry: list[Tensor]  # each (B, *event)


def program_of(
    key: Hashable, prints: Fingerprint, step: Callable[[], Any], rows: Rows, shown: int = 1
) -> Program:
    """The program of a step, traced once a process. Raises `UntraceableError`.

    Of what is carried the first `shown` leaves are kept of each step.
    """
    layout = Layout(
        clock=0,
        constants=tuple(Leaf.of(row.one(), row.shared) for row in rows.constants),
        segments=tuple(tuple(s.shape[2:]) for s in rows.segments),
        noise=(),
        carry=tuple(Leaf.of(c[0]) for c in rows.carry),
        n_motion=sum(leaf[0].numel() for leaf in rows.carry[:shown]),
        watched=(),
    )
    dtype = rows.carry[0].dtype
    with _LOCK:
        found = _PROGRAMS.get((key, layout, dtype))
        if found is None:
            if len(_PROGRAMS) >= _MOST:
                _PROGRAMS.clear()
            one = [row.one() for row in rows.constants]
            examples = [*one, *(s[0, 0] for s in rows.segments), *(c[0] for c in rows.carry)]
            try:
                made: Program | UntraceableError = Program(
                    step(), layout, [x.detach().cpu() for x in examples]
                )
            except UntraceableError as error:
                made = error
            found = _PROGRAMS[key, layout, dtype] = (made, prints.alive)
    if isinstance(found[0], UntraceableError):
        raise UntraceableError(str(found[0]))
    return found[0]


def job_of(program: Program, rows: Rows) -> tuple[Job, tuple[Tensor, Tensor, Tensor, Tensor]]:
    """A march over the rows, and its tensors; every step's first number and the last state kept."""
    T, B = rows.segments[0].shape[:2]
    device, dtype = rows.carry[0].device, rows.carry[0].dtype
    grad = torch.is_grad_enabled()
    used = [rows.constants[i] for i in program.used]
    own = [row.value for row in used if not row.shared]
    slot = torch.full((T + 1,), -1, dtype=torch.int32)
    slot[T] = 0
    job = Job(
        program=program,
        clock=torch.zeros(T, 0, dtype=dtype),
        segment_of=torch.arange(T, dtype=torch.int32),
        noise=None,
        whole=_flat([c for c in own if not c.is_floating_point()], (B,), torch.int64),
        carry_k=_flat([c for c in rows.carry if not c.is_floating_point()], (B,), torch.int64),
        motion_slot=torch.arange(-1, T, dtype=torch.int32),
        state_slot=slot,
        limit=float("inf"),
        tape_memory=_TAPE,
        wanted=(
            tuple(i for i, row in enumerate(used) if row.value.requires_grad and grad),
            tuple(i for i, s in enumerate(rows.segments) if s.requires_grad and grad),
        ),
        device="cpu" if device.type == "cpu" else f"cuda:{device.index or 0}",
    )
    return job, (
        _flat([c for c in own if c.is_floating_point()], (B,), dtype),
        _flat(rows.segments, (T, B), dtype),
        _flat([c for c in rows.carry if c.is_floating_point()], (B,), dtype),
        _flat([row.value for row in used if row.shared], (), dtype),
    )


def _flat(tensors: Sequence[Tensor], shape: tuple[int, ...], dtype: torch.dtype) -> Tensor:
    """Tensors (*shape, *event) side by side: (*shape, M); a mask is 0 or -1."""
    columns = [(-t.long() if t.dtype == torch.bool else t).reshape(*shape, -1) for t in tensors]
    return torch.cat(columns, dim=-1) if columns else torch.zeros(*shape, 0, dtype=dtype)
