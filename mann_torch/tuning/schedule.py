"""How long to tune, and on what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import ConfigError

OPTIMIZERS = ("adam", "lbfgs", "optuna")


@dataclass(frozen=True)
class Schedule:
    """How long to tune, in what steps, on how much of the task.

    `curriculum` holds (iteration, horizon [s]) pairs: from that iteration on no member is longer.
    `minibatch` members are drawn anew each iteration, all of them if None. Adam's `rate` falls to
    a tenth over the run (a half cosine). ``optuna`` takes no gradient: each iteration tries as many
    points as ``smoothed`` by ``joint`` would compute copies.
    """

    iterations: int = 50
    optimizer: str = "adam"
    rate: float = 0.08
    minibatch: int | None = None
    curriculum: Sequence[tuple[int, float]] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise ConfigError(f"iterations = {self.iterations}: at least 1")
        if self.optimizer not in OPTIMIZERS:
            raise ConfigError(f"optimizer '{self.optimizer}': choose from {', '.join(OPTIMIZERS)}")
        if not (math.isfinite(self.rate) and self.rate > 0):
            raise ConfigError(f"rate = {self.rate}: must be finite and > 0")
        if self.minibatch is not None and self.minibatch < 2:
            raise ConfigError(f"minibatch = {self.minibatch}: at least 2 members, for an interval")
        starts = [first for first, _ in self.curriculum]
        if starts != sorted(set(starts)) or any(first < 0 for first in starts):
            raise ConfigError(f"curriculum {list(self.curriculum)}: iterations must increase")
        for _, horizon in self.curriculum:
            if not (math.isfinite(horizon) and horizon > 0):
                raise ConfigError(f"curriculum horizon {horizon}: must be finite and > 0")

    def horizon(self, iteration: int) -> float | None:
        """The longest horizon in force [s]; None for the members' own."""
        known = [horizon for first, horizon in self.curriculum if first <= iteration]
        return known[-1] if known else None
