"""The rollout as a march of the compiled step: which tasks it takes, and how it takes them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Hashable, Sequence
from typing import Any

import torch
from torch import Tensor

from ...compiled import (
    Job,
    Marched,
    Program,
    UntraceableError,
    march,
    missing,
    transformed,
)
from ...compiled.march.agreement import check_agreement
from ...compiled.trace.fingerprint import Fingerprint
from ...errors import ConfigError
from ...signals import Surroundings
from ...trees import leaves, rebuilt
from ...types import LoopState
from ..closed_loop import ClosedLoop
from ..scenario import Scenario
from ..solvers.solver import Solver
from ..step_grid import MERGE, shares_of
from ..task import Effort, Record, Task
from ..trajectory import Status
from .loop_events import LoopEvents, counts_of
from .loop_parts import loop_parts, single_surroundings, surrounding_parts
from .loop_rows import Rows, coefficient_leaves, task_rows
from .loop_step import LoopStep

log = logging.getLogger("mann_torch")
REASON = "the step was traced and compiled"
_KINDS = (Status.OK, Status.DIVERGED, Status.NOT_FINITE)
#: Programs of this process by what they depend on, or why there is none.
_PROGRAMS: dict[Hashable, tuple[Program | UntraceableError, list[Any]]] = {}
_LOCK = threading.RLock()
_MOST = 256


def obstacle(loop: ClosedLoop, scenario: Scenario, solver: Solver) -> str | None:
    """Why this can't even be tried, in a few words; None if it can."""
    if not solver.fuses_step:
        return f"solver {solver.name} chooses its steps by data"
    if any(module._forward_hooks or module._forward_pre_hooks for module in loop.modules()):
        return "forward hooks are not called by the compiled engine"
    if transformed():
        return "torch.func and forward-mode differentiation need the torch engine"
    return missing()


def check_device(device: str) -> None:
    """Raise `ConfigError` for a device that is not here."""
    found = ["cpu"] + [f"cuda:{i}" for i in range(torch.cuda.device_count())]
    if device not in found and not (device == "cuda" and len(found) > 1):
        raise ConfigError(f"device = '{device}': this machine has {', '.join(found)}")


def traced(task: Task) -> tuple[LoopStep, Rows, Program]:
    """The task's step, what it takes, and its program. Raises `UntraceableError`."""
    outside = single_surroundings(task)
    loop_side, outer_side = loop_parts(task), surrounding_parts(task, outside)
    coefficients, template = coefficient_leaves(task)
    names = [part.name for part in loop_side], [part.name for part in outer_side]
    kind = LoopEvents if task.hybrid else LoopStep
    step = kind(task, outside, template, *names)
    rows = task_rows(task, step, [*loop_side, *outer_side], coefficients)
    return step, rows, _program(task, outside, step, rows)


def run(task: Task) -> Record:
    """March the task. Raises `UntraceableError`, with what stands in the way, or `KernelError`."""
    step, rows, program = traced(task)
    constants = [rows.constants[i] for i in program.used]
    floating = [c.is_floating_point() for c in constants]
    # A gradient mode that is off, or a tensor that asks for none, costs nothing.
    wanted = tuple(
        i for i, c in enumerate(constants) if c.requires_grad and torch.is_grad_enabled()
    )
    moving = tuple(
        i for i, s in enumerate(rows.segments) if s.requires_grad and torch.is_grad_enabled()
    )
    job = Job(
        program=program,
        clock=_clock(task),
        segment_of=_segment_of(task),
        noise=_noise(task),
        whole=_flat([c for c, f in zip(constants, floating, strict=True) if not f], task, False),
        carry_k=_flat([c for c in rows.carry if not c.is_floating_point()], task, False),
        motion_slot=_slots(task, task.motion_rows),
        state_slot=_slots(task, task.state_rows),
        limit=task.limit,
        tape_memory=task.tape_memory,
        wanted=(wanted, moving),
        progress=task.progress,
        device="cuda:0" if task.device == "cuda" else task.device,
    )
    tensors = (
        _flat([c for c, f in zip(constants, floating, strict=True) if f], task),
        _stacked(rows.segments, task),
        _flat([c for c in rows.carry if c.is_floating_point()], task),
    )
    backward = torch.is_grad_enabled() and any(t.requires_grad for t in tensors)
    check_agreement(program, job.lanes_used, job.wanted if backward else None)
    found = march(job, *tensors)
    return _record(task, step, program, found)


def _program(task: Task, outside: Surroundings, step: LoopStep, rows: Rows) -> Program:
    """The program of this step, made and compared with eager torch once a process."""
    one = [c[0].detach() for c in rows.constants]
    segment = [s[0, 0].detach() for s in rows.segments]
    layout = step.layout(one, segment)
    prints = Fingerprint()
    parts = (task.loop, task.solver, outside)
    form = [type(x).__name__ for x in (task.state, task.mode, step)]
    key = (
        tuple(prints.of(part) for part in parts), layout, task.noise is None,
        str(step.form()), tuple(form),
    )  # fmt: skip
    with _LOCK:
        found = _PROGRAMS.get(key)
        if found is None:
            if len(_PROGRAMS) >= _MOST:
                _PROGRAMS.clear()
            clock = list(_clock(task)[0].unbind())
            noise = [torch.zeros(n, dtype=torch.float64) for (n,) in layout.noise]
            carry = [c[0].detach() for c in rows.carry]
            try:
                examples = [*clock, *one, *segment, *noise, *carry]
                made: Program | UntraceableError = step.program(step.freeze(), layout, examples)
            except UntraceableError as error:
                made = error
            found = _PROGRAMS[key] = (made, prints.alive)
    if isinstance(found[0], UntraceableError):
        raise UntraceableError(str(found[0]))
    return found[0]


def _clock(task: Task) -> Tensor:
    """(T, C), see `loop_step.CLOCK`."""
    times = task.grid.times
    sizes = times.diff()
    columns = [times[:-1], sizes, times[1:], shares_of(times)[1:]]
    if task.effort_after is not None:
        before = torch.cat([sizes.new_full((1,), torch.inf), sizes[:-1]])
        columns += [1.0 / before, (times[:-1] > task.effort_after + MERGE).double()]
    if task.spans is not None:
        columns += task.spans
    if task.ticks is not None:
        columns += [train.double() for train in task.ticks]
    return torch.stack(columns, dim=-1).contiguous()


def _segment_of(task: Task) -> Tensor:
    segment = torch.zeros(task.grid.n_steps, dtype=torch.int32)
    for number, part in enumerate(task.grid.segments):
        segment[part.first : part.last] = number
    return segment


def _slots(task: Task, rows: list[int]) -> Tensor:
    slot = torch.full((task.grid.n_steps + 1,), -1, dtype=torch.int32)
    slot[rows] = torch.arange(len(rows), dtype=torch.int32)
    return slot


def _noise(task: Task) -> tuple[Tensor, Tensor, Tensor] | None:
    if task.noise is None:
        return None
    return task.noise.unit, task.noise.row.reshape(-1), task.noise_instants.to(torch.int32)


def _flat(tensors: Sequence[Tensor], task: Task, floating: bool = True) -> Tensor:
    """Tensors (B, *event) side by side: (B, M), float64 or int64 with masks as 0 and -1."""
    B = task.batch.numel()
    columns = [
        (-t.long() if t.dtype == torch.bool else t if floating else t.long()).reshape(B, -1)
        for t in tensors
    ]
    if columns:
        return torch.cat(columns, dim=-1)
    return torch.zeros(B, 0, dtype=torch.float64 if floating else torch.int64)


def _stacked(segments: Sequence[Tensor], task: Task) -> Tensor:
    """Coefficients (S, B, *event) side by side: (S, B, Q)."""
    shape = (len(task.grid.segments), task.batch.numel())
    if not segments:
        return torch.zeros(*shape, 0, dtype=torch.float64)
    return torch.cat([s.reshape((*shape, -1)) for s in segments], dim=-1)


def _record(task: Task, step: LoopStep, program: Program, found: Marched) -> Record:
    batch = task.batch
    failed = found.stop < task.grid.n_steps
    done = task.grid.n_steps if not bool(failed.all()) else int(found.stop.max()) + 1
    rows = sum(k <= done for k in task.motion_rows)
    samples = sum(k <= done for k in task.state_rows)
    motion = found.motion[:rows].reshape(rows, *batch, -1)
    shape = (samples, *batch)
    state, _, mode = step.split(_carry(program, found.state_f, found.state_k, shape))
    last = _carry(program, found.last_f, found.last_k, tuple(batch))
    mode_last = step.split(last)[2]
    kinds = torch.tensor([int(code) for code in _KINDS])
    leaf = torch.where(failed, found.cause // 10, -1).long().reshape(batch)
    width = sum(x.shape[-1] for x in leaves(task.state.plant))
    sums = motion[..., width:].split(step.sum_widths[: len(step.sum_widths) - step.measures], -1)
    return Record(
        motion=motion[..., :width],
        squared_error=sums[0],
        followed=None if task.loop.model is None else sums[1],
        effort=Effort(*sums[-2:]) if step.measures else None,
        states=_tree(task.state, state),
        modes=rebuilt(task.mode, mode),
        final_mode=rebuilt(task.mode, mode_last),
        stopped=torch.where(failed, found.stop, -1).long().reshape(batch),
        kind=kinds[(found.cause % 10).long()].reshape(batch),
        leaf=leaf,
        engine="compiled",
        reason=REASON,
        events=counts_of(last[-2]) if task.hybrid else None,
    )


def _tree(template: LoopState, parts: Sequence[Tensor]) -> LoopState:
    return rebuilt(template, parts)


def _carry(program: Program, f: Tensor, k: Tensor, shape: tuple[int, ...]) -> list[Tensor]:
    """Leaves (*shape, *event) of the carry from its two arrays."""
    if f.dim() == 3:  # of the rows that were come to
        f, k = f[: shape[0]], k[: shape[0]]
    return program.layout.carried(f, k, shape)
