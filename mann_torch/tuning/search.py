"""Search without gradients, for comparison: Optuna's tree-structured Parzen estimator."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from ..errors import ConfigError

#: Coordinates are searched within this on both sides of the start: a factor of 7.4 either way.
BOUND = 2.0


def check_search() -> None:
    """Raise `ConfigError` where Optuna is not installed."""
    try:
        import optuna  # noqa: F401
    except ImportError:
        raise ConfigError(
            "optimizer 'optuna' needs the extra: pip install 'mann_torch[search]'"
        ) from None


def propose(history: Sequence[Mapping[str, Any]], count: int, size: int, seed: int) -> Tensor:
    """The next `count` points (count, P) to try, from the records of those tried.

    A study is made anew from the records and its sampler seeded by their number: what comes next
    depends on nothing else. The first point of all is the start.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    names = [f"z{i}" for i in range(size)]
    space = {name: optuna.distributions.FloatDistribution(-BOUND, BOUND) for name in names}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        sampler = optuna.samplers.TPESampler(
            seed=seed * 1_000_003 + len(history), multivariate=True, constant_liar=True
        )
    study = optuna.create_study(sampler=sampler)
    for record in history:
        for point, value in zip(record["tried"], record["values"], strict=True):
            study.add_trial(
                optuna.trial.create_trial(
                    params=dict(zip(names, point, strict=True)), distributions=space, value=value
                )
            )
    trials = [study.ask(space) for _ in range(count)]
    points = torch.tensor(
        [[trial.params[name] for name in names] for trial in trials], dtype=torch.float64
    )
    if not history:
        points[0] = 0.0
    return points
