"""Hybrid rollouts as one hand-written kernel: which tasks it takes, and how it takes them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import cast

import torch
from torch import Tensor

from ..compiled import transformed
from ..control import MannController
from ..errors import ConfigError
from ..fused import LEAVES, Grid, Job, Kept, form_of, march, missing, unfused_part
from ..fused.pack import pack_inputs, pack_mode, unpack_mode
from ..plants import TwoLinkArm
from ..signals import Sinusoid
from ..trees import leaf_names, map_tensors
from ..types import ControllerState, LoopState, MemoryState, NetworkState, PlantState
from .closed_loop import ClosedLoop
from .events import EventCounts
from .implicit import GAMMA, Implicit
from .scenario import Scenario
from .solver import Solver
from .step_grid import shares_of
from .task import Effort, Record, Task
from .trajectory import Status

REASON = "events are located in the hand-written kernel"
KINDS = (Status.OK, Status.DIVERGED, Status.NOT_FINITE)


def obstacle(loop: ClosedLoop, scenario: Scenario, solver: Solver) -> str | None:
    """Why the fused engine can't run this, in a few words; None if it can."""
    if type(loop) is not ClosedLoop:
        return f"{type(loop).__name__} has no fused form"
    if type(solver) is not Implicit:
        return f"solver {solver.name} has no fused form"
    if any(module._forward_hooks or module._forward_pre_hooks for module in loop.modules()):
        return "forward hooks are not called by the fused engine"
    if transformed():
        return "torch.func and forward-mode differentiation need the torch engine"
    return unfused_part(loop.plant, loop.controller, scenario.reference) or missing()


def check_device(device: str) -> None:
    """Raise `ConfigError` for a device that is not here."""
    found = ["cpu"] + [f"cuda:{i}" for i in range(torch.cuda.device_count())]
    if device not in found and not (device == "cuda" and len(found) > 1):
        raise ConfigError(f"device = '{device}': this machine has {', '.join(found)}")


def run(task: Task) -> Record:
    """One launch of the fused kernel, or as many as progress and memory ask for."""
    device = "cuda:0" if task.device == "cuda" else task.device
    batch, n = task.batch, task.state.plant.q.shape[-1]
    plant = cast(TwoLinkArm, task.loop.plant)
    lookups = torch.tensor([part.lookup for part in task.grid.segments], dtype=torch.float64)
    coefficients = [plant.coefficients(task.scenario.parameters_at(t)) for t in lookups]
    form = form_of(
        cast(MannController, task.loop.controller),
        coulomb=any(c.coulomb is not None for c in coefficients),
        follow_reference=cast(Implicit, task.solver).follow_reference,
        noise=task.noise is not None,
        effort=task.effort_after is not None,
        hybrid=task.hybrid,
    )
    inputs = pack_inputs(
        form,
        cast(Sinusoid, task.reference),
        task.loop.controller,
        coefficients,
        plant.coulomb_velocity,
        task.state,
        task.mode,
        shares_of(task.grid.times)[0],
    )
    active, counts = pack_mode(task.mode, task.hybrid)
    there = partial(_moved, device=device)
    job = Job(
        form=form,
        gamma=GAMMA,
        grid=map_tensors(there, _grid(task)),
        **_noise(task, there),
        effort_after=task.effort_after or 0.0,
        horizon=there(task.horizon.reshape(-1)),
        active=map_tensors(there, active),
        counts=map_tensors(there, counts),
        limit=task.limit,
        device=device,
        tape_memory=task.tape_memory,
        progress=task.progress,
    )
    found = march(job, map_tensors(there, inputs))
    kept = map_tensors(partial(_moved, device="cpu"), found)
    failed = kept.stop < task.grid.n_steps
    done = task.grid.n_steps if not bool(failed.all()) else int(kept.stop.max()) + 1
    rows = sum(k <= done for k in task.motion_rows)
    samples = sum(k <= done for k in task.state_rows)
    motion = kept.motion[:rows].reshape(rows, *batch, -1)
    shape = (samples, *batch)
    kind = torch.tensor([int(code) for code in KINDS])[(kept.cause % 10).long()]
    return Record(
        motion=motion[..., : 2 * n],
        squared_error=motion[..., 2 * n : 3 * n],
        effort=None if task.effort_after is None else Effort(*motion[..., 3 * n :].chunk(2, -1)),
        states=_states(task.state, kept, shape),
        modes=unpack_mode(_first(kept.active, samples), _first(kept.counts, samples), shape),
        final_mode=unpack_mode(kept.last_active, kept.last_counts, batch),
        events=_events(kept.last_counts, batch) if task.hybrid else None,
        stopped=torch.where(failed, kept.stop, -1).long().reshape(batch),
        kind=kind.reshape(batch),
        leaf=(_leaf_numbers(task.state)[(kept.cause // 10).long()]).reshape(batch),
        engine="fused",
        reason=REASON,
    )


def _events(counts: Tensor | None, batch: torch.Size) -> EventCounts | None:
    if counts is None:
        return None
    return EventCounts(*counts[:, 3:].long().reshape(*batch, 3).unbind(-1))


def _moved(tensor: Tensor, device: str) -> Tensor:
    return tensor.to(device)


def _first(value: Tensor | None, rows: int) -> Tensor | None:
    return None if value is None else value[:rows]


def _grid(task: Task) -> Grid:
    grid = task.grid
    segment = torch.zeros(grid.n_steps, dtype=torch.int32)
    for number, part in enumerate(grid.segments):
        segment[part.first : part.last] = number
    slots = []
    for rows in (task.motion_rows, task.state_rows):
        slot = torch.full((grid.n_steps + 1,), -1, dtype=torch.int32)
        slot[rows] = torch.arange(len(rows), dtype=torch.int32)
        slots.append(slot)
    index = None if task.noise is None else task.noise_instants.to(torch.int32)
    return Grid(grid.times, segment, slots[0], slots[1], shares_of(grid.times), index)


def _noise(task: Task, there: Callable[[Tensor], Tensor]) -> dict[str, Tensor | None]:
    if task.noise is None:
        return dict.fromkeys(("noise_std", "noise_row", "noise_unit"))
    noise = task.noise
    return {
        "noise_std": there(noise.std.reshape(-1, 2)),
        "noise_row": there(noise.row.reshape(-1).to(torch.int32)),
        "noise_unit": there(noise.unit),
    }


def _states(start: LoopState, kept: Kept, shape: tuple[int, ...]) -> LoopState:
    """Kept leaves (K, B, *event) as a tree of (K, ..., *event)."""

    def leaf(value: Tensor) -> Tensor:
        return value[: shape[0]].reshape(*shape, *value.shape[2:])

    memory = None
    if start.controller.memory is not None and kept.mu is not None:
        if kept.keys is None:  # representation keys: (..., S, 0)
            keys = start.controller.memory.keys.expand(*shape, -1, -1)
        else:
            keys = leaf(kept.keys)
        memory = MemoryState(leaf(kept.mu), keys)
    network = NetworkState(leaf(kept.W), leaf(kept.b_w), leaf(kept.V), leaf(kept.b_v))
    plant = PlantState(leaf(kept.q), leaf(kept.qd))
    return LoopState(plant, ControllerState(network, memory))


def _leaf_numbers(state: LoopState) -> Tensor:
    """Index in `leaf_names(state)` by the kernel's leaf number + 1; -1 for none."""
    names = leaf_names(state)
    return torch.tensor([-1, *(names.index(n) if n in names else -1 for n in LEAVES)])
