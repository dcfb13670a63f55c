"""Rollouts of an ensemble, a chunk of them as one batch."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import torch

from mann_torch import rollout

from ..ensembles.rollouts import Chunk, drawn_of
from ..records.recording import metrics_of
from ..runs.workers import peak_mb
from ..settings.config import ScenarioLoopConfig, SimulateConfig
from ..settings.ensemble_config import EnsembleConfig
from .build import Experiment, build
from .spreads import random_rows, spreads, with_rows

#: Motion is kept this often [s], for SRMSE after 10 s.
MOTION_DT = 10.0


def experiment_of(cfg: EnsembleConfig, first: int, count: int) -> Experiment:
    """Rollouts first to first + count - 1 as one batch. Raises `ConfigError`."""
    names = [field.name for field in dataclasses.fields(ScenarioLoopConfig)]
    plain = dataclasses.replace(
        SimulateConfig(**{name: getattr(cfg, name) for name in names}),
        initial=dataclasses.replace(cfg.initial, draw=cfg.initial.draw + first),
        draws=count,
    )
    made = build(plain)
    plant, parameters = made.loop.plant, made.scenario.parameters._asdict()
    rows = random_rows(parameters, spreads(cfg.spread, plant), cfg.seed, first, count)
    scenario = with_rows(made.scenario, plain.scenario, plant, rows)
    return dataclasses.replace(made, scenario=scenario)


def run_chunk(
    cfg: EnsembleConfig, first: int, count: int, progress: Callable[[int], object]
) -> Chunk:
    """Compute some rollouts; only totals are kept."""
    made = experiment_of(cfg, first, count)
    parameters = made.scenario.parameters
    own = {name: getattr(parameters, name) for name in spreads(cfg.spread, made.loop.plant)}
    with torch.inference_mode():
        trajectory = rollout(
            made.loop,
            made.scenario,
            made.solver,
            weights=made.weights,
            motion_dt=MOTION_DT,
            sample_dt=made.scenario.end,
            sample_until=0.0,
            engine=cfg.solver.engine,
            device=cfg.solver.device,
        )
        found = {name: np.array(column) for name, column in metrics_of(trajectory).items()}
    progress(count)
    return Chunk(
        number=np.arange(first, first + count),
        outputs=np.array(trajectory.outputs, str),
        **drawn_of({name: rows.numpy() for name, rows in own.items()}, count),
        engine=trajectory.engine,
        peak_mb=peak_mb(),
        **found,
    )
