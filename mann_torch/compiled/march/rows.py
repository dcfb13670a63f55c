"""Programs of steps whose tensors are given by the row, and marches over them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..trace.fingerprint import Fingerprint
from ..trace.telling import UntraceableError
from .job import Job
from .layout import Layout, Leaf
from .program import Program, Step

#: Programs of this process by what they depend on, or why there is none.
_PROGRAMS: dict[Hashable, tuple[Program | UntraceableError, list[Any]]] = {}
_LOCK = threading.RLock()
_MOST = 64
#: Bytes of checkpoints beyond which they are farther apart.
_TAPE = 2e9


class Row(NamedTuple):
    """A constant: one value for all samples, (*event), or one each, (B, *event)."""

    value: Tensor
    shared: bool

    def one(self) -> Tensor:
        """As one sample has it."""
        return self.value if self.shared else self.value[0]


class Rows(NamedTuple):
    """What a march takes, a row a sample."""

    constants: list[Row]
    segments: list[Tensor]  # each (T, B, *event)
    carry: list[Tensor]  # each (B, *event)


def program_of(
    key: Hashable, prints: Fingerprint, step: Callable[[], Step], rows: Rows, shown: int = 1
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
