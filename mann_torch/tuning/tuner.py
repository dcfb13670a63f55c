"""Moves constants downhill: a gradient mode, a torch optimizer, a record of every step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from ..errors import ConfigError, SolverError
from .coordinates import Coordinates
from .ensemble import Ensemble, Judge, Score, score
from .gradients import GradientSettings, slope_of
from .objective import Objective
from .slopes import Slope

OPTIMIZERS = ("adam", "lbfgs")


@dataclass(frozen=True)
class Schedule:
    """How long to tune, in what steps, on how much of the task.

    `curriculum` holds (iteration, horizon [s]) pairs: from that iteration on no member is longer.
    `minibatch` members are drawn anew each iteration, all of them if None. Adam's `rate` falls to
    a tenth over the run (a half cosine).
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


@dataclass
class Tuner:
    """State of one tuning run; `step()` until `done`.

    Every iteration draws from a generator seeded by its own number: a run that is loaded from
    `state_dict` goes on exactly as if it had never stopped.
    """

    ensemble: Ensemble
    coordinates: Coordinates
    objective: Objective
    gradient: GradientSettings
    schedule: Schedule
    z: Tensor = field(init=False)
    history: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.gradient.check(len(self.ensemble), self.coordinates, self.schedule.minibatch)
        self.z = torch.zeros(self.coordinates.size, dtype=torch.float64, requires_grad=True)
        self._start: dict[float | None, Score] = {}
        rate = self.schedule.rate
        self._optimizer: torch.optim.Optimizer
        if self.schedule.optimizer == "adam":
            self._optimizer = torch.optim.Adam([self.z], lr=rate)
        else:
            self._optimizer = torch.optim.LBFGS(
                [self.z], lr=1.0, max_iter=3, max_eval=6, line_search_fn="strong_wolfe"
            )

    @property
    def iteration(self) -> int:
        """Number of finished iterations."""
        return len(self.history)

    @property
    def done(self) -> bool:
        """Whether all iterations are finished."""
        return self.iteration >= self.schedule.iterations

    def values(self) -> dict[str, Tensor]:
        """The constants: the mean (in coordinates) over the last quarter of the iterations."""
        last = self.history[-max(1, len(self.history) // 4) :]
        z = torch.tensor([row["z"] for row in last], dtype=torch.float64)
        return self.coordinates.values(z.mean(dim=0))

    def step(self) -> dict[str, Any]:
        """One iteration; returns its record: plain numbers, as `history` keeps them."""
        number = self.iteration
        evaluated: list[Slope] = []

        def closure() -> float:
            slope = self._slope(number)
            evaluated.append(slope)
            self.z.grad = slope.mean.clone()
            return slope.value

        if self.schedule.optimizer == "adam":
            turn = math.cos(math.pi * number / self.schedule.iterations)
            for group in self._optimizer.param_groups:
                group["lr"] = self.schedule.rate * (0.55 + 0.45 * turn)
        self._optimizer.step(closure)
        first = evaluated[0]
        record = {
            "iteration": number,
            "horizon": self.schedule.horizon(number),
            "objective": first.value,
            "z": self.z.detach().tolist(),
            "gradient": first.mean.tolist(),
            "half": first.half.tolist(),
            "silent": first.silent.tolist(),
            "evaluations": len(evaluated),
        }
        self.history.append(record)
        return record

    def _slope(self, number: int) -> Slope:
        generator = torch.Generator().manual_seed(self.schedule.seed * 1_000_003 + number)
        horizon = self.schedule.horizon(number)
        if self.schedule.optimizer == "lbfgs":  # a line search needs one and the same function
            generator.manual_seed(self.schedule.seed)
        start = self._started(horizon)
        ensemble = self.ensemble.until(horizon)
        size = self.schedule.minibatch
        if size is not None and size < len(ensemble):
            chosen = torch.randperm(len(ensemble), generator=generator)[:size].sort().values
            ensemble = ensemble.select(chosen.tolist())
            start = Score(*(leaf[chosen] for leaf in start))
        slope = slope_of(
            ensemble,
            self.coordinates,
            self.z.detach(),
            self._judge(start),
            self.gradient,
            generator,
            progress=number / self.schedule.iterations,
        )
        if not bool(torch.isfinite(slope.mean).all()):
            raise SolverError(f"iteration {number}: the gradient is not finite")
        return slope

    def _judge(self, start: Score) -> Judge:
        return lambda trajectory: self.objective(score(trajectory), start)

    def _started(self, horizon: float | None) -> Score:
        """Scores of the constants one starts from, for every member."""
        if horizon not in self._start:
            found = self.ensemble.until(horizon).scores({})
            if not all(bool(torch.isfinite(leaf).all()) for leaf in found):
                raise SolverError("a member diverges with the constants to start from")
            self._start[horizon] = found
        return self._start[horizon]

    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain numbers only, for `torch.load(weights_only=True)`."""
        return {
            "z": self.z.detach().clone(),
            "optimizer": self._optimizer.state_dict(),
            "history": self.history,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a saved state. Raises `ConfigError` where it does not fit."""
        if state["z"].shape != self.z.shape:
            raise ConfigError(
                f"checkpoint of {len(state['z'])} coordinates, this run has {len(self.z)}"
            )
        with torch.no_grad():
            self.z.copy_(state["z"])
        self._optimizer.load_state_dict(state["optimizer"])
        self.history = list(state["history"])
