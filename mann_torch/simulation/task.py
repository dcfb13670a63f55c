"""What a rollout asks of an engine, and what an engine gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ..functional import as_float64
from ..signals import NoiseTable, Reference, noise_at
from ..types import LoopState, Measurement, Mode, NetworkState
from .closed_loop import ClosedLoop
from .events.steps import EventCounts
from .scenario import Scenario
from .solvers.solver import Solver
from .step_grid import StepGrid


@dataclass(frozen=True)
class Task:
    """A checked rollout: every part has the batch shape `...`."""

    loop: ClosedLoop
    scenario: Scenario
    solver: Solver
    grid: StepGrid
    reference: Reference
    state: LoopState  # at t = 0
    mode: Mode
    horizon: Tensor  # (...,) [s]
    motion_rows: list[int]  # step times at which joint motion is kept
    state_rows: list[int]  # step times at which whole states are kept
    noise: NoiseTable | None  # on what is measured
    noise_instants: Tensor  # (T,) int64, sampling instant of each step
    limit: float = 1e8
    progress: Callable[[int], object] | None = None
    device: str = "cpu"
    tape_memory: float = 256e6  # [bytes]
    effort_after: float | None = None  # peak torques count from here on [s]; None: no effort
    hybrid: bool = False  # steps locate events, see `events/steps.hybrid_step`

    def noise_in(self, k: int) -> Measurement | None:
        """What the sensors add in step k, each member (..., n)."""
        if self.noise is None:
            return None
        return noise_at(self.noise, self.noise_instants[k])

    @property
    def batch(self) -> torch.Size:
        """Batch shape `...`."""
        return self.state.plant.q.shape[:-1]


def task_of(
    loop: ClosedLoop, scenario: Scenario, solver: Solver, network: NetworkState, grid: StepGrid
) -> Task:
    """The rollout from these initial weights, of which both ends are kept.

    Raises `ShapeError`, `DomainError`.
    """
    state, mode = loop.initial_state(scenario, network)
    batch = state.plant.q.shape[:-1]
    noise, instants = scenario.noise, torch.zeros(grid.n_steps, dtype=torch.int64)
    table = None
    if noise is not None:
        instants = noise.instants(grid.times[:-1])
        table = noise.expand(batch).table(state.plant.q.shape[-1], int(instants[-1]) + 1)
    return Task(
        loop=loop,
        scenario=scenario,
        solver=solver,
        grid=grid,
        reference=scenario.reference.expand(batch),
        state=state,
        mode=mode,
        horizon=as_float64(scenario.horizon).expand(batch),
        motion_rows=[0, grid.n_steps],
        state_rows=[0],
        noise=table,
        noise_instants=instants,
    )


class Effort(NamedTuple):
    """What the torque costs, running over the steps within a sample's horizon.

    A step's torque is that at its start, noise included; its rate is what changed since the step
    before, over that step's length.
    """

    rate_square: Tensor  # (T', ..., n) integral of the squared rate [(N m)^2/s]
    peak: Tensor  # (T', ..., n) largest |torque| since `effort_after` [N m]


@dataclass(frozen=True)
class Record:
    """What an engine kept. Where every sample failed, rows after the last failure are missing."""

    motion: Tensor  # (T', ..., 2n) q and qd
    squared_error: Tensor  # (T', ..., n) running sum of squared error times its share of time
    effort: Effort | None
    states: LoopState  # (K, ..., *event)
    modes: Mode  # (K, ..., *event)
    final_mode: Mode
    stopped: Tensor  # (...,) int64, step that failed; -1 where none did
    kind: Tensor  # (...,) int64, values of `Status`
    leaf: Tensor  # (...,) int64, first leaf of the state that failed; -1 where none did
    engine: str
    reason: str  # why this engine
    events: EventCounts | None = None  # each (...,); None in plain rollouts
