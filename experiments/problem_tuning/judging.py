"""One way of choosing a problem's constants: tuned if it is, then judged on other members."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from mann_torch.tuning import (
    Coordinates,
    Criterion,
    GradientSettings,
    Limit,
    Schedule,
    Tuner,
    constants_at,
)

from ..settings.problem_tuning_config import ProblemTuningConfig
from . import quadrotor, rohrs
from .tuned_problem import TunedProblem, Way

PROBLEMS: dict[str, Callable[[ProblemTuningConfig], TunedProblem]] = {
    "quadrotor": quadrotor.problem,
    "rohrs": rohrs.problem,
}


@dataclass(frozen=True)
class Found:
    """What a way came to."""

    error: np.ndarray  # (members,) RMS, held out
    effort: np.ndarray  # (members,) RMS input
    objective: np.ndarray  # (iterations,) of the training; empty where nothing was tuned
    constants: dict[str, np.ndarray]


def steps_of(cfg: ProblemTuningConfig, way: Way) -> int:
    """How often `judged_way` reports progress."""
    return 1 + (cfg.iterations if way.tuned else 0)


def judged_way(
    cfg: ProblemTuningConfig, problem: str, name: str, progress: Callable[[int], object]
) -> Found:
    """Set what is known, tune what is tuned, judge."""
    torch.set_num_threads(1)
    task = PROBLEMS[problem](cfg)
    way = task.ways[name]
    loop = task.train.ensemble.loop
    known = {k: torch.tensor(v, dtype=torch.float64) for k, v in way.known.items()}
    loop.initialize(**known)
    objective: list[float] = []
    values = known
    if way.tuned:
        tuner = tuner_of(cfg, task, way)
        while not tuner.done:
            objective.append(tuner.step()["objective"])
            progress(1)
        values = known | tuner.values()
    error, effort = judge(task, values)
    progress(1)
    kept = {name: np.asarray(value) for name, value in values.items()}
    return Found(error, effort, np.array(objective), kept)


def tuner_of(cfg: ProblemTuningConfig, task: TunedProblem, way: Way) -> Tuner:
    """Plain gradients through the loop: nothing in these problems switches."""
    members = task.train
    limits = {"effort": Limit(members.effort, cfg.effort_limit, relative=True)}
    return Tuner(
        members.ensemble,
        Coordinates(members.ensemble.loop, way.tuned, "full"),
        Criterion(members.error, limits),
        GradientSettings(mode="plain"),
        Schedule(iterations=cfg.iterations, rate=cfg.rate, seed=cfg.seed),
    )


def judge(task: TunedProblem, values: dict[str, Tensor]) -> tuple[np.ndarray, np.ndarray]:
    """RMS error and RMS input of the held-out members."""
    members = task.held_out
    with torch.no_grad(), constants_at(members.ensemble.loop, values):
        run = members.ensemble.run({}, recording=members.error.recording)
        error, effort = members.error(run), members.effort(run)
    effort = torch.where(error.isfinite(), effort, torch.nan)
    return error.numpy(), effort.numpy()
