"""How a loop would be run here: on which engine, why, and how fast."""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..checks import instance
from ..functional import Numbers, as_float64
from ..memory import relaxed
from ..trees import leaf_names, leaves
from .closed_loop import ClosedLoop
from .engines import compiled_engine
from .gradients import check_gradient, locates_events
from .rollout import rollout
from .scenario import Scenario
from .solvers.implicit import Implicit
from .solvers.solver import Solver
from .step_grid import StepGrid
from .task import task_of, trains_of
from .trajectory import Trajectory

#: Seconds that the measured rollout should take, and steps it begins with.
ENOUGH, FIRST = 0.2, 8


@dataclass(frozen=True)
class Explanation:
    """What `explain` found; `str` of it is the page."""

    engine: str  # "compiled"; of the torch engine "eager" or "torch.compile"
    reason: str  # why this engine
    operations: Mapping[str, int]  # torch operations of a traced step, how often each; empty: none
    state: Mapping[str, tuple[int, ...]]  # shape of each leaf of one trajectory's state
    mode: Mapping[str, tuple[int, ...]]  # and of what its jumps change
    batch: tuple[int, ...]  # trajectories that the scenario asks for
    steps_per_second: float  # of all of them together, forwards
    first_s: float  # time of the first rollout here: tracing, compiling or loading [s]
    dt: float  # step [s]

    @property
    def n_state(self) -> int:
        """Numbers that a trajectory carries from step to step."""
        return sum(map(math.prod, (*self.state.values(), *self.mode.values())))

    def __str__(self) -> str:
        count = math.prod(self.batch)
        rows = [("engine", self.engine), ("reason", self.reason)]
        if self.operations:
            most = sorted(self.operations.items(), key=lambda item: -item[1])
            named = ", ".join(f"{name} {n}" for name, n in most[:8])
            more = f", and {len(most) - 8} more" if len(most) > 8 else ""
            rows.append(("operations", f"{sum(self.operations.values())}: {named}{more}"))
        kinds = [("state", self.state), ("mode", self.mode)]
        for name, shapes in kinds:
            listed = ", ".join(f"{leaf} {_shape(shape)}" for leaf, shape in shapes.items())
            rows.append((name, f"{sum(map(math.prod, shapes.values()))} numbers: {listed or '-'}"))
        simulated = self.steps_per_second * self.dt / max(count, 1)
        rows.append(
            (
                "speed",
                f"{self.steps_per_second:,.0f} steps/s forwards, {count} trajector"
                f"{'y' if count == 1 else 'ies'} on {torch.get_num_threads()} threads; "
                f"{simulated:,.3g} simulated seconds a second",
            )
        )
        rows.append(("first run", f"{self.first_s:.2g} s"))
        return "\n".join(f"{name:<10} {text}" for name, text in rows)


def explain(
    loop: ClosedLoop,
    scenario: Scenario,
    solver: Solver | None = None,
    *,
    weights: Any = None,
    gradient: str = "plain",
    temperature: Numbers | None = None,
) -> Explanation:
    """Print, and return, how `rollout` would run this: engine, reason, operations, state, speed.

    Takes what `rollout` takes, runs some steps of it, and raises what that raises.
    docs/compiling.md says how to read it.
    """
    instance("loop", loop, ClosedLoop)
    instance("scenario", scenario, Scenario).check()
    solver = Implicit() if solver is None else solver
    check_gradient(gradient, solver, temperature, loop)

    def run(steps: int) -> tuple[Trajectory, float]:
        """So many steps, or all of the scenario, and their time."""
        shorter = as_float64(scenario.horizon).clamp(max=steps * solver.dt)
        start = time.perf_counter()
        with torch.no_grad():
            found = rollout(
                loop,
                dataclasses.replace(scenario, horizon=shorter),
                solver,
                weights=weights,
                motion_dt=max(steps * solver.dt, solver.dt),
                sample_until=0.0,
                gradient=gradient,
                temperature=temperature,
            )
        return found, time.perf_counter() - start

    most = math.ceil(scenario.end / solver.dt)
    steps = min(FIRST, most)
    ran_here, first = run(steps)
    spent = run(steps)[1]
    while spent < 0.5 * ENOUGH and steps < most and not bool((ran_here.status != 0).any()):
        steps = min(most, int(steps * min(32.0, max(2.0, ENOUGH / spent))))
        ran_here, spent = run(steps)
    engine, reason = ran_here.engine, ran_here.engine_reason
    ran = loop if temperature is None else relaxed(loop, temperature)
    grid = StepGrid(solver.dt, [], solver.dt, trains_of(ran) or ())
    task = task_of(ran, scenario, solver, grid, weights)
    operations: Mapping[str, int] = {}
    if engine == "compiled":
        task = dataclasses.replace(task, hybrid=locates_events(gradient, ran))
        operations = dict(compiled_engine.traced(task)[2].scope.operations)
    depth, size = len(task.batch), task.batch.numel()

    def shapes(tree: object) -> dict[str, tuple[int, ...]]:
        parts: list[Tensor] = leaves(tree)
        return {n: tuple(x.shape[depth:]) for n, x in zip(leaf_names(tree), parts, strict=True)}

    found = Explanation(
        engine=engine,
        reason=reason,
        operations=operations,
        state=shapes(task.state),
        mode=shapes(task.mode),
        batch=tuple(task.batch),
        steps_per_second=steps * size / spent,
        first_s=first,
        dt=solver.dt,
    )
    sys.stdout.write(f"{found}\n")
    return found


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) if shape else "1"
