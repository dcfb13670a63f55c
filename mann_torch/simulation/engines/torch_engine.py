"""Steps of a whole batch in PyTorch: any loop, any solver."""

from __future__ import annotations

import torch
from torch import Tensor

from ...trees import Packer, map_tensors
from ...types import LoopState
from ..events.steps import no_events
from ..step_grid import MERGE, counted_in, shares_of
from ..task import Effort, Record, Task
from ..trajectory import Status
from .stepping import Carry, Stepper


def run(task: Task, reason: str) -> Record:
    """Jump, flow, record; autograd runs through all of it."""
    loop, grid, batch = task.loop, task.grid, task.batch
    n = task.state.plant.q.shape[-1]
    packer = Packer(task.state, len(batch))
    y = packer.pack(task.state)
    measured = task.effort_after is not None
    stepper = Stepper(loop, task.solver, packer, task.limit, measured, task.hybrid)
    events = no_events(batch) if task.hybrid else None
    carry = Carry(y, task.mode, torch.ones(batch, dtype=torch.bool), events=events)
    safe = fallen = torch.zeros_like(y, requires_grad=False)
    stopped = torch.full(batch, -1)
    sampled = set(task.state_rows)
    motion, kept = [y[..., : 2 * n].clone()], [carry] if 0 in sampled else []
    torques: list[Tensor] = []
    times, sizes = grid.times.unbind(), grid.times.diff().unbind()
    n_alive, done = carry.alive.numel(), 0
    for segment in grid.segments:
        lookup = torch.tensor(segment.lookup, dtype=torch.float64)
        coefficients = loop.plant.coefficients(task.scenario.parameters_at(lookup))
        for k in range(segment.first, segment.last):
            arguments = (task.reference, coefficients, task.noise_in(k))
            before = carry
            if n_alive == before.alive.numel():
                carry = stepper(times[k], sizes[k], before, *arguments)
            if n_alive < before.alive.numel() or not bool(carry.alive.all()):
                carry, bad = stepper.without_dead(times[k], sizes[k], before, safe, *arguments)
                fell = before.alive & ~carry.alive
                stopped = torch.where(fell, k, stopped)
                fallen = torch.where(fell.unsqueeze(-1), bad, fallen)
                n_alive = int(carry.alive.sum())
            motion.append(carry.y[..., : 2 * n].clone())
            if carry.torque is not None:
                torques.append(carry.torque)
            if k + 1 in sampled:
                kept.append(carry)
            done += 1
            if task.progress is not None and done % 100 == 0:
                task.progress(100)
            if n_alive == 0:
                break
        if n_alive == 0:
            break
    if task.progress is not None:
        task.progress(done % 100)
    track = torch.stack(motion)
    rows = [k for k in task.motion_rows if k <= done]
    squared = _squared_error(task, track[..., :n], stopped)
    kind, leaf = _causes(packer, fallen, stopped, task.limit)
    return Record(
        motion=track[rows],
        squared_error=squared[rows],
        effort=map_tensors(lambda sums: sums[rows], _effort(task, torques, stopped)),
        states=packer.unpack(torch.stack([c.y for c in kept])),
        modes=map_tensors(lambda *leaves: torch.stack(leaves), *[c.mode for c in kept]),
        final_mode=carry.mode,
        events=carry.events,
        stopped=stopped,
        kind=kind,
        leaf=leaf,
        engine=stepper.engine,
        reason=reason,
    )


def _squared_error(task: Task, q: Tensor, stopped: Tensor) -> Tensor:
    """Running sum of e^2 times its share of time, up to each sample's horizon or failure."""
    index = torch.arange(len(q)).reshape(-1, *(1,) * len(task.batch))
    counted = counted_in(task.grid.times, task.horizon)[: len(q)] & (
        (stopped < 0) | (index <= stopped)
    )
    share = shares_of(task.grid.times)[: len(q)].reshape(index.shape) * counted
    error = task.reference(task.grid.times[: len(q)]).q - q
    return (share.unsqueeze(-1) * error.square()).cumsum(dim=0)


def _effort(task: Task, torques: list[Tensor], stopped: Tensor) -> Effort | None:
    """Running effort of steps within each sample's horizon, up to its failure."""
    if task.effort_after is None or not torques:
        return None
    torque, times = torch.stack(torques), task.grid.times[: len(torques) + 1]
    column = (-1, *(1,) * len(task.batch))
    index = torch.arange(len(torque)).reshape(column)
    counted = counted_in(times[1:], task.horizon) & ((stopped < 0) | (index < stopped))
    change = torch.cat([torch.zeros_like(torque[:1]), torque.diff(dim=0)])
    sizes = torch.cat([torch.ones(1, dtype=torque.dtype), times[:-1].diff()])
    weight = torch.where(counted, 1.0 / sizes.reshape(column), 0.0).unsqueeze(-1)
    rate = (weight * change.square()).cumsum(dim=0)
    late = counted & (times[:-1] > task.effort_after + MERGE).reshape(column)
    peak = torch.where(late.unsqueeze(-1), torque.abs(), 0.0).cummax(dim=0).values
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
