"""Steps of a whole batch in PyTorch: any loop, any solver."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from ...compiled import transformed
from ...trees import Packer, map_tensors
from ...types import LoopState
from ..conditions import Conditions
from ..events.steps import no_events
from ..outputs import outputs_of
from ..step_grid import MERGE, counted_in, shares_of
from ..task import Effort, Record, Task
from ..trajectory import Status
from .stepping import Carry, Stepper
from .torch_block import Block, Front, Snapshot, Trail, joined, plant_width, trail_of, twin

#: Steps that are computed again at a time, where not all fit on the tape.
BLOCK = 20
#: What autograd keeps of a step [bytes]: in any case, and for each number of the state.
NODES, EACH = 5e5, 50.0


def run(task: Task, reason: str) -> Record:
    """Jump, flow, record; autograd runs through all of it.

    Where a tape of all steps would take more than `task.tape_memory`, it holds the ends of blocks
    alone, and the backward pass computes each block again.
    """
    batch = task.batch
    width = plant_width(task)
    packer = Packer(task.state, len(batch))
    y = packer.pack(task.state)
    measured = task.effort_after is not None
    stepper = Stepper(task.loop, task.solver, packer, task.limit, measured, task.hybrid)
    events = no_events(batch) if task.hybrid else None
    carry = Carry(y, task.mode, torch.ones(batch, dtype=torch.bool), events=events)
    front = Front(carry, torch.full(batch, -1), torch.zeros_like(y, requires_grad=False))
    began = _at_start(task)
    trails = [trail_of([y[..., :width]], began, [carry] if 0 in task.state_rows else [], [])]
    long, before = _is_long(task, y), Snapshot(task)
    again: tuple[Task, Stepper] | None = None
    for first, last, coefficients in _blocks(task):
        if again is not None:
            found = Block(*again, coefficients, first, last).recomputed(front)
        else:
            found = Block(task, stepper, coefficients, first, last).run(front)
            if long and first == 0 and before.unchanged():
                copies = twin(task)
                own = Stepper(copies.loop, copies.solver, packer, task.limit, measured, task.hybrid)
                if Block(copies, own, coefficients, first, last).can_be_cut(front):
                    again = copies, own
        front = found.front
        trails.append(found.trail)
        if task.progress is not None:
            task.progress(len(found.trail.motion))
        if not bool(front.carry.alive.any()):
            break
    trail, stopped = joined(trails), front.stopped
    rows = [k for k in task.motion_rows if k < len(trail.motion)]
    squared = _squared_error(task, trail, stopped)
    kind, leaf = _causes(packer, front.fallen, stopped, task.limit)
    return Record(
        motion=trail.motion[rows],
        squared_error=squared[rows],
        followed=None if trail.followed is None else trail.followed[rows],
        effort=map_tensors(lambda sums: sums[rows], _effort(task, trail.inputs, stopped)),
        states=packer.unpack(trail.states),
        modes=trail.modes,
        final_mode=front.carry.mode,
        events=front.carry.events,
        stopped=stopped,
        kind=kind,
        leaf=leaf,
        engine=stepper.engine,
        reason=reason,
    )


def _at_start(task: Task) -> list[Tensor]:
    """What a reference model gives at t = 0, if there is one."""
    if task.loop.model is None:
        return []
    here = Conditions(task.surroundings, task.coefficients(0))
    return [task.loop.error(torch.zeros((), dtype=torch.float64), task.state, here)[1]]


def _blocks(task: Task) -> Iterator[tuple[int, int, Any]]:
    """First and last step of each block, and the plant's coefficients in it."""
    for number, segment in enumerate(task.grid.segments):
        coefficients = task.coefficients(number)
        for first in range(segment.first, segment.last, BLOCK):
            yield first, min(first + BLOCK, segment.last), coefficients


def _is_long(task: Task, y: Tensor) -> bool:
    """Whether the tape of all steps would be too large, and may be cut into blocks."""
    # torch.func and forward mode would not see through the cut; nor do compiled steps.
    if not torch.is_grad_enabled() or transformed() or task.solver.compile:
        return False
    return task.grid.n_steps * (NODES + EACH * y.numel()) > task.tape_memory


def _squared_error(task: Task, trail: Trail, stopped: Tensor) -> Tensor:
    """Running sum of e^2 times its share of time, up to each sample's horizon or failure."""
    count, times = len(trail.motion), task.grid.times[: len(trail.motion)]
    index = torch.arange(count).reshape(-1, *(1,) * len(task.batch))
    counted = counted_in(task.grid.times, task.horizon)[:count] & (
        (stopped < 0) | (index <= stopped)
    )
    share = shares_of(task.grid.times)[:count].reshape(index.shape) * counted
    wanted = trail.followed
    if wanted is None:
        wanted = task.surroundings(times).reference.value
    error = wanted - outputs_of(task, times, trail.motion)
    return (share.unsqueeze(-1) * error.square()).cumsum(dim=0)


def _effort(task: Task, inputs: Tensor | None, stopped: Tensor) -> Effort | None:
    """Running effort of steps within each sample's horizon, up to its failure."""
    if task.effort_after is None or inputs is None:
        return None
    times = task.grid.times[: len(inputs) + 1]
    column = (-1, *(1,) * len(task.batch))
    index = torch.arange(len(inputs)).reshape(column)
    counted = counted_in(times[1:], task.horizon) & ((stopped < 0) | (index < stopped))
    change = torch.cat([torch.zeros_like(inputs[:1]), inputs.diff(dim=0)])
    sizes = torch.cat([torch.ones(1, dtype=inputs.dtype), times[:-1].diff()])
    weight = torch.where(counted, 1.0 / sizes.reshape(column), 0.0).unsqueeze(-1)
    rate = (weight * change.square()).cumsum(dim=0)
    late = counted & (times[:-1] > task.effort_after + MERGE).reshape(column)
    peak = torch.where(late.unsqueeze(-1), inputs.abs(), 0.0).cummax(dim=0).values
    nothing = torch.zeros_like(rate[:1])
    return Effort(torch.cat([nothing, rate]), torch.cat([nothing, peak]))


def _causes(
    packer: Packer[LoopState], fallen: Tensor, stopped: Tensor, limit: float
) -> tuple[Tensor, Tensor]:
    """Status and number of the first leaf out of range of each sample that failed."""
    kind = torch.full_like(stopped, int(Status.OK))
    leaf = torch.full_like(stopped, -1)
    for number, part in enumerate(packer.split(fallen)):
        finite = torch.isfinite(part).all(dim=-1)
        bad = (stopped >= 0) & (leaf < 0) & ~(part.abs() < limit).all(dim=-1)
        code = torch.where(finite, int(Status.DIVERGED), int(Status.NOT_FINITE))
        kind = torch.where(bad, code, kind)
        leaf = torch.where(bad, number, leaf)
    return kind, leaf
