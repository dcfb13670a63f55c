"""Run a case: at the step of its settings, and at half of it."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mann_torch import rollout
from mann_torch.simulation.step_grid import StepGrid

from ..building.build import Experiment, build
from ..building.ensembles import composed
from ..building.sizes import check_samples
from ..records.arrays import signal_arrays
from ..runs.figures import of_draws
from ..settings.benchmarks_config import BenchmarksConfig
from ..settings.config import SimulateConfig
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


def settings(cfg: BenchmarksConfig, overrides: Sequence[str], finer: bool) -> SimulateConfig:
    """The `simulate` configuration of overrides, the user's after the case's.

    Raises `ConfigError`.
    """
    plain = composed((*overrides, *cfg.overrides))
    dt = plain.solver.dt / 2 if finer else plain.solver.dt
    solver = dataclasses.replace(plain.solver, dt=dt, engine=cfg.engine)
    return dataclasses.replace(plain, solver=solver)


def _experiments(cfg: BenchmarksConfig, case: Case, finer: bool) -> list[Experiment]:
    every = (case.overrides, *case.others)
    return [build(settings(cfg, overrides, finer)) for overrides in every]


def n_steps(cfg: BenchmarksConfig, problem: str, name: str) -> int:
    """Steps of a case's rollouts, for the progress bar. Raises `ConfigError`."""
    case, found = case_of(problem, name), 0
    check_samples(
        settings(cfg, case.overrides, False),
        _experiments(cfg, case, False)[0].scenario.end,
        case.sample_dt,
    )
    for finer in (False, True) if cfg.halved else (False,):
        for made in _experiments(cfg, case, finer):
            scenario = made.scenario
            found += StepGrid(scenario.end, scenario.knots(), made.solver.dt).n_steps
    return found


def run_case(
    cfg: BenchmarksConfig, problem: str, name: str, progress: Callable[[int], object]
) -> CaseResult:
    """Roll one case out and measure it."""
    case, start = case_of(problem, name), time.perf_counter()
    measured, runs = [], []
    for finer in (False, True) if cfg.halved else (False,):
        first, *others = [
            rolled(made, case.sample_dt, cfg.engine, progress)
            for made in _experiments(cfg, case, finer)
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
        arrays=_thinned(run.arrays),
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


def _thinned(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    stride = -(-len(arrays["t"]) // MOST_ROWS)
    return {
        name: array if array.dtype.kind == "U" else array[::stride]
        for name, array in arrays.items()
    }
