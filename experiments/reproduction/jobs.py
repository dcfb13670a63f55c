"""Run a job: it is one controller variant, a batched rollout a horizon."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mann_torch import Trajectory, rollout
from mann_torch.simulation.step_grid import StepGrid

from ..building.batching import side_by_side
from ..building.build import Experiment, build
from ..building.ensembles import composed
from ..building.sizes import check_samples
from ..records.arrays import signal_arrays
from ..records.recording import metrics_of
from ..runs.figures import of_draws
from ..settings.config import ReproduceConfig, SimulateConfig
from .plan import Job

SAMPLE_DT = 0.05


@dataclass(frozen=True)
class JobResult:
    """Numbers of one variant: arrays (scenarios, draws, .), signals of recorded scenarios."""

    job: Job
    srmse: np.ndarray  # (scenarios, draws, 2) [rad]
    srmse_after_10s: np.ndarray
    reallocations: np.ndarray  # (scenarios, draws)
    switches: np.ndarray
    status: list[list[str]]
    signals: dict[str, dict[str, np.ndarray]]  # scenario -> arrays of `signal_arrays`
    engine: str
    n_hidden: int

    def arrays(self) -> dict[str, np.ndarray]:
        """What an .npz file of this result holds."""
        flat = {
            "scenarios": np.array(self.job.scenarios),
            "srmse": self.srmse,
            "srmse_after_10s": self.srmse_after_10s,
            "reallocations": self.reallocations,
            "switches": self.switches,
            "status": np.array(self.status),
            "engine": np.array(self.engine),
            "n_hidden": np.array(self.n_hidden),
        }
        for scenario, arrays in self.signals.items():
            flat |= {f"{scenario}/{name}": array for name, array in arrays.items()}
        return flat

    @classmethod
    def kept(cls, job: Job, path: Path) -> JobResult | None:
        """What an .npz file of this job holds; None if there is none that can be read."""
        try:
            with np.load(path) as file:
                arrays = dict(file)
            signals: dict[str, dict[str, np.ndarray]] = {}
            for key in (key for key in arrays if "/" in key):
                scenario, name = key.split("/", 1)
                signals.setdefault(scenario, {})[name] = arrays[key]
            return cls(
                job,
                srmse=arrays["srmse"],
                srmse_after_10s=arrays["srmse_after_10s"],
                reallocations=arrays["reallocations"],
                switches=arrays["switches"],
                status=arrays["status"].tolist(),
                signals=signals,
                engine=str(arrays["engine"]),
                n_hidden=int(arrays["n_hidden"]),
            )
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None


def job_config(cfg: ReproduceConfig, job: Job, scenario: str) -> SimulateConfig:
    """The `simulate` configuration of one scenario of a job. Raises `ConfigError`."""
    plain = composed((f"scenario='{scenario}'", *job.overrides))
    horizon = plain.scenario.horizon
    if cfg.horizon is not None:
        horizon = min(horizon, cfg.horizon)
    return dataclasses.replace(
        plain,
        solver=cfg.solver,
        initial=cfg.initial,
        draws=cfg.draws,
        seed=cfg.seed,
        horizon=horizon,
    )


def check_recorded(cfg: ReproduceConfig, job: Job) -> None:
    """Raise `ConfigError` where what a job keeps of its recorded scenarios is too much."""
    for scenario in job.recorded:
        plain = job_config(cfg, job, scenario)
        if plain.horizon is not None:
            check_samples(plain, plain.horizon, SAMPLE_DT)


def batches(cfg: ReproduceConfig, job: Job) -> list[tuple[list[str], Experiment]]:
    """The job's scenarios of each horizon, and all their draws as one experiment.

    A batch runs to its longest horizon: scenarios of different horizons would waste steps.
    """
    parts = {scenario: build(job_config(cfg, job, scenario)) for scenario in job.scenarios}
    groups: dict[float, list[str]] = {}
    for scenario, part in parts.items():
        groups.setdefault(part.scenario.end, []).append(scenario)
    return [(names, _batched([parts[n] for n in names], cfg.draws)) for names in groups.values()]


def _batched(parts: list[Experiment], draws: int) -> Experiment:
    """Scenarios and draws of one controller as one experiment of batch (scenarios * draws,)."""
    scenario, weights, own = side_by_side(parts, draws)
    first = parts[0]
    first.loop.controller.initialize(**own)
    return Experiment(first.loop, scenario, first.solver, weights)


def n_steps(cfg: ReproduceConfig, job: Job) -> int:
    """Steps of the job's rollouts, for the progress bar."""
    scenarios = [experiment.scenario for _, experiment in batches(cfg, job)]
    return sum(StepGrid(s.end, s.knots(), cfg.solver.dt).n_steps for s in scenarios)


def run_job(cfg: ReproduceConfig, job: Job, progress: Callable[[int], object]) -> JobResult:
    """Simulate one job."""
    rows: dict[str, dict[str, Any]] = {}
    signals: dict[str, dict[str, np.ndarray]] = {}
    engines = set()
    for scenarios, experiment in batches(cfg, job):
        with torch.inference_mode():
            trajectory = _run(
                cfg, experiment, [s for s in scenarios if s in job.recorded], progress
            )
            metrics = metrics_of(trajectory)
        engines.add(trajectory.engine)
        for number, scenario in enumerate(scenarios):
            chosen = slice(number * cfg.draws, (number + 1) * cfg.draws)
            rows[scenario] = {name: column[chosen] for name, column in metrics.items()}
            if scenario in job.recorded:
                with torch.inference_mode():
                    arrays = signal_arrays(experiment.loop, experiment.scenario, trajectory)
                signals[scenario] = of_draws(arrays, chosen)

    def column(name: str) -> np.ndarray:
        return np.array([rows[scenario][name] for scenario in job.scenarios])

    return JobResult(
        job=job,
        srmse=column("srmse"),
        srmse_after_10s=column("srmse_after_10s"),
        reallocations=column("reallocations"),
        switches=column("switches"),
        status=[rows[scenario]["status"] for scenario in job.scenarios],
        signals=signals,
        engine=", ".join(sorted(engines)),
        n_hidden=int(trajectory.states.controller.network.b_v.shape[-1]),
    )


def _run(
    cfg: ReproduceConfig,
    experiment: Experiment,
    recorded: list[str],
    progress: Callable[[int], object],
) -> Trajectory:
    return rollout(
        experiment.loop,
        experiment.scenario,
        experiment.solver,
        weights=experiment.weights,
        sample_dt=SAMPLE_DT,
        sample_until=None if recorded else 0.0,
        motion_dt=SAMPLE_DT,
        engine=cfg.solver.engine,
        device=cfg.solver.device,
        progress=progress,
    )
