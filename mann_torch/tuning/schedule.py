"""How long to tune, and on what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..checks import POSITIVE, choice, number, several, whole
from ..errors import ConfigError

OPTIMIZERS = ("adam", "lbfgs", "optuna")


@dataclass(frozen=True)
class Schedule:
    """How long to tune, in what steps, on how much of the task.

    `curriculum` holds (iteration, horizon [s]) pairs: from that iteration on no member is longer.
    `minibatch` members are drawn anew each iteration, all of them if None. Adam's `rate` falls to
    a tenth over the run (a half cosine). ``optuna`` takes no gradient: each iteration tries as many
    points as ``smoothed`` by ``joint`` would compute copies.

    Raises `ConfigError`, `KindError`.
    """

    iterations: int = 50
    optimizer: str = "adam"
    rate: float = 0.08
    minibatch: int | None = None
    curriculum: Sequence[tuple[int, float]] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        whole("iterations", self.iterations)
        choice("optimizer", self.optimizer, OPTIMIZERS)
        number("rate", self.rate, POSITIVE)
        if self.minibatch is not None:  # at least 2 members, for an interval
            whole("minibatch", self.minibatch, least=2)
        whole("seed", self.seed, least=None)
        starts = []
        for i, pair in enumerate(several("curriculum", self.curriculum, object, "pairs")):
            row = several(f"curriculum[{i}]", pair, object, "an iteration and a horizon")
            if len(row) != 2:
                raise ConfigError(f"curriculum[{i}] = {row}: give an iteration and a horizon")
            starts.append(whole(f"curriculum[{i}] iteration", row[0], least=0))
            number(f"curriculum[{i}] horizon", row[1], POSITIVE)
        if starts != sorted(set(starts)):
            raise ConfigError(f"curriculum {list(self.curriculum)}: iterations must increase")

    def horizon(self, iteration: int) -> float | None:
        """The longest horizon in force [s]; None for the members' own."""
        known = [horizon for first, horizon in self.curriculum if first <= iteration]
        return known[-1] if known else None
