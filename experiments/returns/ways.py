"""One controller in all draws, its constants tuned first where they are to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from mann_torch import Trajectory, input_rate
from mann_torch.simulation import Status
from mann_torch.tuning import (
    MOTION,
    Coordinates,
    Criterion,
    Ensemble,
    GradientSettings,
    Judged,
    Limit,
    Schedule,
    Tuner,
    constants_at,
)

from ..building.build import Experiment, build
from ..building.ensembles import composed
from ..settings.returning_config import ReturningConfig
from .regimes import regimes

#: Number of the first draw to be tuned on: no draw is judged on that is.
TRAINING = 1_000_000


@dataclass(frozen=True)
class Found:
    """What a controller came to."""

    after: np.ndarray  # (visits, draws) RMS error in the window after each change
    whole: np.ndarray  # (draws,) RMS error over all
    rate: np.ndarray  # (draws,) RMS rate of the input
    error: np.ndarray  # (blocks,) RMS over draws, over time
    constants: dict[str, np.ndarray]


def built(cfg: ReturningConfig, name: str) -> Experiment:
    """The loop of a way. Raises `ConfigError`."""
    return build(composed((*cfg.shared, *cfg.ways[name].overrides)))


def steps_of(cfg: ReturningConfig, name: str) -> int:
    """How often `run_way` reports progress."""
    return 1 + (cfg.iterations if cfg.ways[name].tuned else 0)


def run_way(cfg: ReturningConfig, name: str, progress: Callable[[int], object]) -> Found:
    """Tune what is to be tuned on draws of their own, then go through all draws."""
    torch.set_num_threads(1)
    made, way = built(cfg, name), cfg.ways[name]
    values: dict[str, Tensor] = {}
    if way.tuned:
        tuner = tuner_of(cfg, made, way.tuned)
        while not tuner.done:
            tuner.step()
            progress(1)
        values = tuner.values()
    ensemble = ensemble_of(cfg, made, cfg.draws, 0)
    with torch.no_grad(), constants_at(made.loop, values):
        run = ensemble.run({}, recording=MOTION)
    progress(1)
    ok = run.status == int(Status.OK)
    after = torch.where(ok, after_changes(cfg, run), torch.nan)
    squared = run.error[..., 0].square()
    per_block = round(0.25 * cfg.window / made.solver.dt)
    blocks = squared[: len(squared) // per_block * per_block].unflatten(0, (-1, per_block))
    return Found(
        after.numpy(),
        torch.where(ok, squared.mean(0).sqrt(), torch.nan).numpy(),
        input_rate(run)[..., 0].numpy(),
        blocks.mean(dim=(1, 2)).sqrt().numpy(),
        {name: np.asarray(value) for name, value in values.items()},
    )


def ensemble_of(cfg: ReturningConfig, made: Experiment, count: int, first: int) -> Ensemble:
    """Draws of one loop."""
    scenario = regimes(cfg, made.loop.plant, count, first)
    return Ensemble(made.loop, scenario, None, made.solver, effort_after=0.0)


def after_changes(cfg: ReturningConfig, run: Trajectory) -> Tensor:
    """RMS error in the window after each change (visits, ..., B)."""
    squared, t = run.error[..., 0].square(), run.t
    found = []
    for visit in range(cfg.n_regimes * cfg.visits):
        begin = visit * cfg.visit_length
        inside = (t >= begin - 1e-9) & (t < begin + cfg.window)
        found.append(squared[inside].mean(dim=0).sqrt())
    return torch.stack(found)


def tuner_of(cfg: ReturningConfig, made: Experiment, names: list[str]) -> Tuner:
    """Error after returns, with no more input rate than the first way has; smoothed gradients.

    theta enters by comparison alone, so that plain ones would be 0.
    """
    ensemble = ensemble_of(cfg, made, cfg.training, TRAINING)
    baseline = ensemble_of(cfg, built(cfg, cfg.variants[0]), cfg.training, TRAINING)
    allowed = baseline.scores({}).rate  # member by member
    returns = slice(cfg.n_regimes, None)

    def error(run: Trajectory) -> Tensor:
        return after_changes(cfg, run)[returns].mean(dim=0)

    def rate(run: Trajectory) -> Tensor:
        return input_rate(run)[..., 0] / allowed

    return Tuner(
        ensemble,
        Coordinates(made.loop, names),
        Criterion(Judged(error, MOTION), {"rate": Limit(Judged(rate, MOTION), 1.0)}),
        GradientSettings(mode="smoothed"),
        Schedule(iterations=cfg.iterations, rate=0.15, seed=cfg.seed),
    )
