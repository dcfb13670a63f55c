"""Run a case: at the step of its settings, and at half of it."""

from __future__ import annotations

import copy
import dataclasses
import functools
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from mann_torch import rollout
from mann_torch.simulation.step_grid import StepGrid

from ..building.build import Experiment, build
from ..building.ensembles import composed
from ..building.sizes import check_steps
from ..records.arrays import signal_arrays
from ..runs.figures import of_draws
from ..settings.benchmarks_config import BenchmarksConfig
from .every import PROBLEMS
from .known import Case
from .run import Run

#: Rows of an array that are kept on disk, at most.
MOST_ROWS = 2001


@dataclass(frozen=True)
class CaseResult:
    """Ours of one case, in the order of what is known."""

    ours: np.ndarray  # (rows,) NaN where nothing is measured
    finer: np.ndarray  # (rows,) at half the step; NaN where that is not done
    arrays: dict[str, np.ndarray]  # `signal_arrays` of one draw, thinned
    status: str
    engine: str
    dt: float  # [s]
    wall_s: float


def case_of(problem: str, case: str) -> Case:
    """A case by its names."""
    return PROBLEMS[problem].cases[case]


def experiments_of(cfg: BenchmarksConfig, case: Case) -> list[Experiment]:
    """A case's loops with their scenarios; the user's overrides come after the case's.

    Raises `ConfigError`.
    """
    made = []
    for overrides in (case.overrides, *case.others):
        plain = composed((*overrides, *cfg.overrides))
        solver = dataclasses.replace(plain.solver, engine=cfg.engine)
        made.append(build(dataclasses.replace(plain, solver=solver)))
    return made


def finer(made: Experiment) -> Experiment:
    """The same at half the step."""
    solver = copy.copy(made.solver)
    solver.dt = made.solver.dt / 2
    return dataclasses.replace(made, solver=solver)


def n_steps(cfg: BenchmarksConfig, problem: str, name: str) -> int:
    """Steps of a case's rollouts, for the progress bar. Raises `ConfigError`."""
    return _n_steps(cfg.engine, cfg.halved, tuple(cfg.overrides), problem, name)


@functools.cache
def _n_steps(engine: str, halved: bool, overrides: tuple[str, ...], problem: str, name: str) -> int:
    cfg = BenchmarksConfig(engine=engine, overrides=list(overrides))
    case, found = case_of(problem, name), 0
    for made in experiments_of(cfg, case):
        scenario = made.scenario
        check_steps(scenario.end, case.sample_dt)
        for dt in (made.solver.dt, made.solver.dt / 2) if halved else (made.solver.dt,):
            found += StepGrid(scenario.end, scenario.knots(), dt).n_steps
    return found


def run_case(
    cfg: BenchmarksConfig, problem: str, name: str, progress: Callable[[int], object]
) -> CaseResult:
    """Roll one case out and measure it."""
    case, start = case_of(problem, name), time.perf_counter()
    measured, runs = [], []
    every = experiments_of(cfg, case)
    for experiments in (every, [finer(made) for made in every]) if cfg.halved else (every,):
        first, *others = [
            rolled(made, case.sample_dt, cfg.engine, progress) for made in experiments
        ]
        run = dataclasses.replace(first, others=tuple(others))
        runs.append(run)
        measured.append([_measured(run, known.measure) for known in case.known])
    if not cfg.halved:
        measured.append([float("nan")] * len(case.known))
    run = runs[0]
    return CaseResult(
        ours=np.array(measured[0]),
        finer=np.array(measured[1]),
        arrays=_kept(run),
        status="; ".join(run.trajectory.describe_status()),
        engine=run.trajectory.engine,
        dt=float(run.experiment.solver.dt),
        wall_s=time.perf_counter() - start,
    )


def rolled(
    made: Experiment, sample_dt: float, engine: str, progress: Callable[[int], object]
) -> Run:
    """One rollout of one draw."""
    with torch.inference_mode():
        trajectory = rollout(
            made.loop,
            made.scenario,
            made.solver,
            weights=made.weights,
            sample_dt=sample_dt,
            engine=engine,
            progress=progress,
        )
        arrays = signal_arrays(made.loop, made.scenario, trajectory)
    return Run(made, trajectory, of_draws(arrays, 0))


def _measured(run: Run, measure: Callable[[Run], float] | None) -> float:
    if measure is None:
        return float("nan")
    with torch.inference_mode():
        return measure(run)


def _kept(run: Run) -> dict[str, np.ndarray]:
    """What a picture shows: `beside` are outputs of the other rollouts, by their references'."""
    arrays = dict(run.arrays)
    stride = -(-len(arrays["t"]) // MOST_ROWS)
    asked = [float(one.arrays["reference"][-1, 0]) for one in (run, *run.others)]
    if run.others and all(asked):
        columns = [one.arrays["output"][:, 0] for one in run.others]
        arrays["beside"] = np.stack(
            [y * asked[0] / size for y, size in zip(columns, asked[1:], strict=True)], axis=-1
        )
    return {
        name: array if array.dtype.kind == "U" else array[::stride]
        for name, array in arrays.items()
    }
