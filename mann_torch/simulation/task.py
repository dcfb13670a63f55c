"""What a rollout asks of an engine, and what an engine gives back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..functional import as_float64
from ..signals import NoiseTable, Surroundings, noise_at
from ..trees import leaves
from ..types import LoopMode, LoopState, Snapshot
from .closed_loop import ClosedLoop
from .conditions import Conditions, Span, Ticks, spans_of
from .events.steps import EventCounts
from .scenario import Scenario
from .solvers.solver import Solver
from .starting import coefficients_of, start_of
from .step_grid import MERGE, StepGrid, Train


@dataclass(frozen=True)
class Task:
    """A checked rollout: every part has the batch shape `...`."""

    loop: ClosedLoop
    scenario: Scenario
    solver: Solver
    grid: StepGrid
    surroundings: Surroundings
    state: LoopState  # at t = 0
    mode: LoopMode
    horizon: Tensor  # (...,) [s]
    motion_rows: list[int]  # step times at which the plant's state is kept
    state_rows: list[int]  # step times at which whole states are kept
    noise: NoiseTable | None  # on what is measured
    noise_instants: Tensor  # (T,) int64, sampling instant of each step
    ticks: tuple[Tensor, Tensor] | None = None  # (T,) bool each, of sensor and clock
    spans: Span | None = None  # each (T,), of signals that jump
    limit: float = 1e8
    progress: Callable[[int], object] | None = None
    device: str = "cpu"
    tape_memory: float = 256e6  # [bytes]
    effort_after: float | None = None  # peak inputs count from here on [s]; None: no effort
    hybrid: bool = False  # steps locate events, see `events/steps.hybrid_step`
    known: dict[int, Any] = field(default_factory=dict)  # coefficients by segment

    def conditions(self, k: int, coefficients: Any) -> Conditions:
        """What step k is under."""
        noise = None if self.noise is None else noise_at(self.noise, self.noise_instants[k])
        ticks = None if self.ticks is None else Ticks(*(bool(train[k]) for train in self.ticks))
        span = None if self.spans is None else Span(*(edge[k] for edge in self.spans))
        return Conditions(self.surroundings, coefficients, noise, ticks, span)

    def coefficients(self, segment: int) -> Any:
        """The plant's in a segment of the grid, of the whole batch."""
        if segment not in self.known:
            time = torch.tensor(self.grid.segments[segment].lookup, dtype=torch.float64)
            found = coefficients_of(self.loop, self.scenario, self.batch, time)
            self.known[segment] = found
        return self.known[segment]

    @property
    def batch(self) -> torch.Size:
        """Batch shape `...`."""
        return leaves(self.state.plant)[0].shape[:-1]

    @property
    def n_inputs(self) -> int:
        """m."""
        return len(self.loop.plant.inputs)

    @property
    def n_outputs(self) -> int:
        """p."""
        return len(self.loop.plant.outputs)


def trains_of(loop: ClosedLoop) -> tuple[Train, Train] | None:
    """When sensor and clock tick, each at the other's instants if it has none of its own."""
    if not loop.samples:
        return None
    clock = None if loop.clock is None else Train(loop.clock.period, loop.clock.offset)
    sensor = None
    if loop.sensor is not None and loop.sensor.period is not None:
        sensor = Train(loop.sensor.period)
    found = [train for train in (sensor, clock) if train is not None]
    return sensor or found[0], clock or found[0]


def grid_of(loop: ClosedLoop, scenario: Scenario, dt: float) -> StepGrid:
    """The steps of a rollout: they end on jumps of parameters, and on ticks."""
    jumps = scenario.surroundings.jumps(scenario.end)
    before = [time for time in jumps if time < scenario.end - MERGE]
    trains = [*(trains_of(loop) or ()), *map(Train, loop.controller.periods)]
    return StepGrid(scenario.end, scenario.knots(), dt, trains, before)


def task_of(
    loop: ClosedLoop,
    scenario: Scenario,
    solver: Solver,
    grid: StepGrid,
    weights: Any = None,
    generator: torch.Generator | None = None,
    batch_shape: Sequence[int] = (),
    begin: Snapshot | None = None,
) -> Task:
    """The rollout from these initial weights, of which both ends are kept.

    Raises `ShapeError`, `DomainError`.
    """
    start = start_of(loop, scenario, weights, generator, batch_shape, begin)
    batch = leaves(start.state.plant)[0].shape[:-1]
    noise, instants = scenario.noise, torch.zeros(grid.n_steps, dtype=torch.int64)
    table = None
    if noise is not None:
        instants = noise.instants(grid.times[:-1])
        widths = [part.shape[-1] for part in start.measured]
        table = noise.expand(batch).table(widths, int(instants[-1]) + 1)
    return Task(
        loop=loop,
        scenario=scenario,
        solver=solver,
        grid=grid,
        surroundings=start.surroundings,
        state=start.state,
        mode=start.mode,
        horizon=as_float64(scenario.horizon).expand(batch),
        motion_rows=[0, grid.n_steps],
        state_rows=[0],
        noise=table,
        noise_instants=instants,
        ticks=(grid.ticks(0), grid.ticks(1)) if loop.samples else None,
        spans=spans_of(grid.times) if grid.jumps else None,
    )


class Effort(NamedTuple):
    """What the commanded input costs, running over the steps within a sample's horizon.

    A step's input is that at its start, noise included; its rate is what changed since the step
    before, over that step's length.
    """

    rate_square: Tensor  # (T', ..., m) integral of the squared rate [unit^2/s]
    peak: Tensor  # (T', ..., m) largest |input| since `effort_after`


@dataclass(frozen=True)
class Record:
    """What an engine kept. Where every sample failed, rows after the last failure are missing."""

    motion: Tensor  # (T', ..., M) state of the plant
    squared_error: Tensor  # (T', ..., p) running sum of squared error times its share of time
    followed: Tensor | None  # (T', ..., p) output of a reference model
    effort: Effort | None
    states: LoopState  # (K, ..., *event)
    modes: LoopMode  # (K, ..., *event)
    final_mode: LoopMode
    stopped: Tensor  # (...,) int64, step that failed; -1 where none did
    kind: Tensor  # (...,) int64, values of `Status`
    leaf: Tensor  # (...,) int64, first leaf of the state that failed; -1 where none did
    engine: str
    reason: str  # why this engine
    events: EventCounts | None = None  # each (...,); None in plain rollouts
