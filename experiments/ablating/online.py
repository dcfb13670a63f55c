"""Online regression under returning changes, by one learner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..learning.online_measures import in_blocks
from ..learning.online_passes import learn
from ..settings.ablation_config import ROWS, AblationConfig
from ..settings.memory_config import OnlineRegressionConfig
from .part import Part

#: Samples of a point of the curve.
BLOCK = 25
MEASURES = ("after_switch", "steady", "before_return")


def settings(cfg: AblationConfig, variant: str) -> OnlineRegressionConfig:
    """As `online_regression` takes them."""
    slots, table = ROWS["online"][variant], cfg.online
    return OnlineRegressionConfig(
        variants=[kind(variant)],
        rates=table.rates,
        visits=table.visits,
        visit_length=table.visit_length,
        seeds=table.seeds,
        n_slots=max(1, slots.memory, slots.readouts),
        recall_time=cfg.recall_time,
        sharpness=cfg.online_sharpness,
        wiped=slots.wiped,
        seed=cfg.seed,
    )


def kind(variant: str) -> str:
    """The learner, by its name in `online_regression`; memories with hard attention."""
    slots = ROWS["online"][variant]
    return "readouts" if slots.readouts else "hard" if slots.memory else "network"


def count(cfg: AblationConfig, variant: str) -> int:
    """How often `run` reports progress: visits."""
    own = settings(cfg, variant)
    tuning = len(own.rates) * own.tuning_visits if len(own.rates) > 1 else 0
    return own.n_functions * (own.visits + tuning)


def run(cfg: AblationConfig, variant: str, progress: Callable[[int], object]) -> Part:
    """At the rate that was best on other streams."""
    own = settings(cfg, variant)
    found = learn(own, kind(variant), progress)
    curve = in_blocks(found.rmse, BLOCK)
    return Part(
        {name: found.measures[name] for name in MEASURES},
        {"rate": np.array(found.rate)},
        curve,
        BLOCK * own.dt * (np.arange(len(curve)) + 0.5),
    )
