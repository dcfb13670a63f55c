"""Recall by backpropagation, by one cell."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..peering.report import mean_curve, measured
from ..peering.training import learn
from ..sequence_tasks.every import TASKS
from ..settings.ablation_config import AblationConfig
from ..settings.peers_config import PeersConfig, RecallConfig
from .part import Part


def settings(cfg: AblationConfig, variant: str) -> PeersConfig:
    """As `peers` takes them."""
    table = cfg.recall
    return PeersConfig(
        rates={variant: table.rate},
        recall=RecallConfig(iterations=table.iterations),
        hidden_size=table.hidden_size,
        seeds=table.seeds,
        seed=cfg.seed,
    )


def run(cfg: AblationConfig, variant: str, progress: Callable[[int], object]) -> Part:
    """All seeds, one after the other."""
    own = settings(cfg, variant)
    runs = []
    for seed in range(own.seeds):
        runs.append(learn(own, "recall", variant, seed))
        progress(1)
    curve = mean_curve(runs)
    return Part(
        {**measured(TASKS["recall"](own), runs)},
        {
            "size": np.array(runs[0].size),
            "parameters": np.array(runs[0].parameters),
            "least": np.array(min(run.score for run in runs)),
            "most": np.array(max(run.score for run in runs)),
        },
        curve,
        own.every * np.arange(len(curve), dtype=float),
    )
