"""A cell's steps over a sequence on the compiled engine (`mann_torch.compiled`).

What a step makes of x alone is there before (`MemoryCell.look`): a row of segments a step. What is
traced and marched is `stepped`, of one sample.
"""

from __future__ import annotations

import threading
from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..compiled import (
    Fingerprint,
    Job,
    Layout,
    Leaf,
    Program,
    UntraceableError,
    check_agreement,
    frozen,
    march,
    missing,
    transformed,
    with_tensors,
)
from ..constraints import DesignModule
from .cell import MemoryCell
from .cell_state import CellState, Looked
from .steps import Marks, stepped

#: Programs of this process by what they depend on, or why there is none.
_PROGRAMS: dict[Hashable, tuple[Program | UntraceableError, list[Any]]] = {}
_LOCK = threading.RLock()
_MOST = 64
_DTYPES = (torch.float32, torch.float64)
#: Bytes of checkpoints beyond which they are farther apart.
_TAPE = 2e9


def obstacle(cell: MemoryCell, x: Tensor) -> str | None:
    """Why this can't even be tried, in a few words; None if it can."""
    if torch.compiler.is_compiling():
        return "torch.compile and torch.export take the steps themselves"
    if cell.dtype not in _DTYPES:
        return f"the compiled engine computes in float32 and float64, not {cell.dtype}"
    if x.device.type not in ("cpu", "cuda"):
        return f"there is no compiled engine on {x.device.type}"
    if any(m._forward_hooks or m._forward_pre_hooks for m in cell.memory.modules()):
        return "forward hooks are not called by the compiled engine"
    if transformed():
        return "torch.func and forward-mode differentiation need the torch engine"
    return missing()


class Held(NamedTuple):
    """The tensors of a cell that its steps may read: the memory, and what a run starts from."""

    names: list[str]
    rows: list[Tensor]  # each (*event) if it is for all samples, else (B, *event)
    alone: list[bool]  # whether it is for all samples

    @classmethod
    def of(cls, cell: MemoryCell, batch: torch.Size) -> Held:
        """A design constant with a batch of values has a row a sample."""
        found: dict[str, Tensor] = {"slots": cell.slots, "slot_keys": cell.slot_keys}
        found |= {f"memory.{n}": t for n, t in cell.memory.named_parameters()}
        found |= {f"memory.{n}": t for n, t in cell.memory.named_buffers()}
        dims = {name: tensor.dim() for name, tensor in found.items()}
        for prefix, part in cell.memory.named_modules(prefix="memory"):
            if isinstance(part, DesignModule):
                for name, domain in part.domains().items():
                    found[f"{prefix}.{name}"] = getattr(part, name)
                    dims[f"{prefix}.{name}"] = domain.event_dims
        alone = [tensor.dim() == dims[name] for name, tensor in found.items()]
        rows = [
            tensor if one else _rows(tensor, dims[name], batch)
            for (name, tensor), one in zip(found.items(), alone, strict=True)
        ]
        return cls(list(found), rows, alone)


def _rows(x: Tensor, event_dims: int, batch: torch.Size) -> Tensor:
    event = x.shape[x.dim() - event_dims :]
    return x.expand((*batch, *event)).reshape(batch.numel(), *event)


def run(
    cell: MemoryCell, looked: Looked, state: CellState, marks: Marks
) -> tuple[Tensor, CellState]:
    """Reads (T, *batch, N) and the last state. Raises `UntraceableError`, `KernelError`.

    `looked` (T, *batch, ...), `state` (*batch, ...) and `marks` (T, *batch) have one batch shape.
    """
    batch, device = state.attended.shape, looked.hidden.device
    B, T = batch.numel(), len(looked.hidden)
    segments = [leaf.reshape(T, B, *leaf.shape[1 + len(batch) :]) for leaf in looked]
    segments += [leaf.reshape(T, B).to(cell.dtype) for leaf in marks if leaf is not None]
    read = torch.zeros_like(looked.hidden[0]).detach()
    carry = [leaf.reshape((B, *leaf.shape[len(batch) :])) for leaf in (read, *state)]
    held = Held.of(cell, batch)
    program = _program(cell, held, segments, carry, marks)
    chosen = [held.rows[i] for i in program.used]
    grad = torch.is_grad_enabled()
    wanted = tuple(i for i, c in enumerate(chosen) if c.requires_grad and grad)
    moving = tuple(i for i, s in enumerate(segments) if s.requires_grad and grad)
    constants = [
        row.expand((B, *row.shape)) if held.alone[i] else row
        for i, row in zip(program.used, chosen, strict=True)
    ]
    slot = torch.full((T + 1,), -1, dtype=torch.int32)
    slot[T] = 0
    job = Job(
        program=program,
        clock=torch.zeros(T, 0, dtype=cell.dtype),
        segment_of=torch.arange(T, dtype=torch.int32),
        noise=None,
        whole=_flat([c for c in constants if not c.is_floating_point()], (B,), torch.int64),
        carry_k=_flat([c for c in carry if not c.is_floating_point()], (B,), torch.int64),
        motion_slot=torch.arange(-1, T, dtype=torch.int32),
        state_slot=slot,
        limit=float("inf"),
        tape_memory=_TAPE,
        wanted=(wanted, moving),
        device="cpu" if device.type == "cpu" else f"cuda:{device.index or 0}",
    )
    tensors = (
        _flat([c for c in constants if c.is_floating_point()], (B,), cell.dtype),
        _flat(segments, (T, B), cell.dtype),
        _flat([c for c in carry if c.is_floating_point()], (B,), cell.dtype),
    )
    backward = grad and any(t.requires_grad for t in tensors)
    check_agreement(program, job.lanes_used, job.wanted if backward else None)
    found = march(job, *tensors)
    last = _leaves(program.layout, found.state_f[0], found.last_k)[1:]
    last = [leaf.reshape((*batch, *leaf.shape[1:])).to(device) for leaf in last]
    reads = found.motion.reshape(T, *batch, -1).to(device)
    return reads, CellState(*last)


def _flat(tensors: Sequence[Tensor], shape: tuple[int, ...], dtype: torch.dtype) -> Tensor:
    """Tensors (*shape, *event) side by side: (*shape, M); a mask is 0 or -1."""
    columns = [(-t.long() if t.dtype == torch.bool else t).reshape(*shape, -1) for t in tensors]
    return torch.cat(columns, dim=-1) if columns else torch.zeros(*shape, 0, dtype=dtype)


def _leaves(layout: Layout, f: Tensor, k: Tensor) -> list[Tensor]:
    """Leaves (B, *event) of the carry from its two arrays."""
    found = []
    for leaf, (array, offset) in zip(layout.carry, layout.carry_places, strict=True):
        size = torch.Size(leaf.shape).numel()
        value = (f if array == "f" else k)[:, offset : offset + size].reshape(len(f), *leaf.shape)
        found.append(value != 0 if leaf.kind == "b" else value)
    return found


class Step:
    """A step of one sample, as the compiler takes it."""

    def __init__(self, cell: MemoryCell, names: Sequence[str], marks: Marks) -> None:
        self._cell, self._names = frozen(cell), names
        self._marked = [leaf is not None for leaf in marks]

    def __call__(
        self,
        clock: Sequence[Tensor],
        constants: Sequence[Tensor],
        segments: Sequence[Tensor],
        noise: Sequence[Tensor],
        carry: Sequence[Tensor],
    ) -> list[Tensor]:
        """The next carry: the read and the state."""
        count = len(Looked._fields)
        given = iter(segments[count:])
        marks = Marks(*(next(given) > 0.5 if there else None for there in self._marked))
        with with_tensors(self._cell, dict(zip(self._names, constants, strict=True))):
            read, state = stepped(
                self._cell, Looked(*segments[:count]), CellState(*carry[1:]), marks
            )
        return [read, *state]


def _program(
    cell: MemoryCell,
    held: Held,
    segments: Sequence[Tensor],
    carry: Sequence[Tensor],
    marks: Marks,
) -> Program:
    """The program of this cell's steps, traced once a process."""
    one = [row if alone else row[0] for row, alone in zip(held.rows, held.alone, strict=True)]
    layout = Layout(
        clock=0,
        constants=tuple(map(_leaf, one)),
        segments=tuple(tuple(s.shape[2:]) for s in segments),
        noise=(),
        carry=tuple(_leaf(c[0]) for c in carry),
        n_motion=carry[0].shape[-1],
        watched=(),
    )
    prints = Fingerprint()
    marked = tuple(leaf is not None for leaf in marks)
    key = (type(cell), prints.of(cell.memory), layout, marked, cell.dtype)
    with _LOCK:
        found = _PROGRAMS.get(key)
        if found is None:
            if len(_PROGRAMS) >= _MOST:
                _PROGRAMS.clear()
            examples = [*one, *(s[0, 0] for s in segments), *(c[0] for c in carry)]
            try:
                made: Program | UntraceableError = Program(
                    Step(cell, held.names, marks), layout, [x.detach().cpu() for x in examples]
                )
            except UntraceableError as error:
                made = error
            found = _PROGRAMS[key] = (made, prints.alive)
    if isinstance(found[0], UntraceableError):
        raise UntraceableError(str(found[0]))
    return found[0]


def _leaf(x: Tensor) -> Leaf:
    return Leaf(
        tuple(x.shape), "f" if x.is_floating_point() else "b" if x.dtype == torch.bool else "i"
    )
