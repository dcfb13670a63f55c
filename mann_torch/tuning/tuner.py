"""Moves constants downhill: a gradient mode, a torch optimizer, a record of every step."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from ..checks import function, instance, number, several
from ..errors import ConfigError, SolverError
from ..trees import leaves, map_tensors
from .coordinates import Coordinates
from .ensemble import Ensemble
from .gradients import GradientSettings, slope_of
from .judges import Judge, Judged
from .objective import Aim, Objective
from .schedule import Schedule
from .search import check_search, propose
from .slopes import Slope


@dataclass
class Tuner:
    """State of one tuning run; `step()` until `done`.

    Every iteration draws from a generator seeded by its own number: a run that is loaded from
    `state_dict` goes on exactly as if it had never stopped. `objective` is an `Objective` or, with
    a judge and limits of one's own, a `Criterion`. `begin` (P,) are the coordinates to begin at, 0
    if not given; the objective is relative to the constants at 0 in any case.

    Raises `ConfigError` where the parts do not fit, `KindError`.
    """

    ensemble: Ensemble
    coordinates: Coordinates
    objective: Aim
    gradient: GradientSettings
    schedule: Schedule
    z: Tensor = field(init=False)
    history: list[dict[str, Any]] = field(default_factory=list)
    begin: Tensor | None = None

    def __post_init__(self) -> None:
        instance("ensemble", self.ensemble, Ensemble)
        instance("coordinates", self.coordinates, Coordinates)
        function("objective", self.objective)
        function("objective.measure", getattr(self.objective, "measure", None))
        if isinstance(self.objective, Objective):
            self.objective.check_fit(self.ensemble)
        instance("gradient", self.gradient, GradientSettings)
        instance("schedule", self.schedule, Schedule)
        several("history", instance("history", self.history, list), dict)
        self.gradient.check(len(self.ensemble), self.coordinates, self.schedule.minibatch)
        self.z = torch.zeros(self.coordinates.size, dtype=torch.float64, requires_grad=True)
        if self.begin is not None:
            self._begin_at(instance("begin", self.begin, Tensor))
        self._start: dict[float | None, Any] = {}
        rate = self.schedule.rate
        self._optimizer: torch.optim.Optimizer | None = None
        if self.schedule.optimizer == "optuna":
            check_search()
        elif self.schedule.optimizer == "adam":
            self._optimizer = torch.optim.Adam([self.z], lr=rate)
        else:
            self._optimizer = torch.optim.LBFGS(
                [self.z], lr=1.0, max_iter=3, max_eval=6, line_search_fn="strong_wolfe"
            )

    def _begin_at(self, z: Tensor) -> None:
        if self.schedule.optimizer == "optuna":
            raise ConfigError("optimizer 'optuna' begins everywhere: give it another seed instead")
        if z.shape != self.z.shape or not bool(torch.isfinite(z).all()):
            raise ConfigError(f"begin = {z.tolist()}: give {len(self.z)} finite coordinates")
        with torch.no_grad():
            self.z.copy_(z)

    @property
    def iteration(self) -> int:
        """Number of finished iterations."""
        return len(self.history)

    @property
    def done(self) -> bool:
        """Whether all iterations are finished."""
        return self.iteration >= self.schedule.iterations

    def values(self) -> dict[str, Tensor]:
        """The constants: the mean (in coordinates) over the last quarter of the iterations.

        Of a search without gradients, the best it tried.
        """
        count = 1 if self._optimizer is None else max(1, len(self.history) // 4)
        last = self.history[-count:]
        z = torch.tensor([row["z"] for row in last], dtype=torch.float64)
        return self.coordinates.values(z.mean(dim=0))

    def step(self) -> dict[str, Any]:
        """One iteration; returns its record: plain numbers, as `history` keeps them."""
        number = self.iteration
        if self._optimizer is None:
            return self._search(number)
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
            "evaluations": len(evaluated),
        }
        self.history.append(record)
        return record

    def signal(self, share: float = 0.25) -> Slope:
        """The mean gradient over a first share of the iterations, with its interval.

        Where that contains 0, nothing told the tuner where to take a coordinate. (Later on an
        optimum is near, where it should.)
        """
        share = number("share", share)
        rows = self.history[: max(1, math.ceil(share * len(self.history)))]
        gradient, half = (
            torch.tensor([row[name] for row in rows], dtype=torch.float64).nan_to_num()
            for name in ("gradient", "half")
        )
        pooled = half.square().sum(dim=0).sqrt() / len(rows)
        return Slope(gradient.mean(dim=0), pooled, rows[0]["objective"])

    def silent(self) -> list[str]:
        """Coordinates without a signal, neither at first nor over the whole run."""
        quiet = self.signal().silent & self.signal(1.0).silent
        return [label for label, q in zip(self.coordinates.labels, quiet, strict=True) if q]

    def _search(self, number: int) -> dict[str, Any]:
        """Points tried side by side; `z` is the best of all iterations."""
        ensemble, start = self._members(number, self._generator(number))
        count = 2 * self.gradient.pairs_for(len(ensemble), self.coordinates.size)
        points = propose(self.history, count, self.coordinates.size, self.schedule.seed)
        found = ensemble.judged(
            self.coordinates.values(points.unsqueeze(1)), self._judge(start)
        ).mean(dim=-1)
        tried, values = points.tolist(), found.tolist()
        best, z = min(zip(values, tried, strict=True))
        if self.history and self.history[-1]["objective"] <= best:
            best, z = self.history[-1]["objective"], self.history[-1]["z"]
        record = {
            "iteration": number,
            "horizon": self.schedule.horizon(number),
            "objective": best,
            "z": z,
            "tried": tried,
            "values": values,
            "gradient": [0.0] * len(z),
            "half": [0.0] * len(z),
            "evaluations": 1,
        }
        self.history.append(record)
        return record

    def _generator(self, number: int) -> torch.Generator:
        if self.schedule.optimizer == "lbfgs":  # a line search needs one and the same function
            number = 0
        return torch.Generator().manual_seed(self.schedule.seed * 1_000_003 + number)

    def _members(self, number: int, generator: torch.Generator) -> tuple[Ensemble, Any]:
        """This iteration's members, and what the start was measured to be on them."""
        horizon = self.schedule.horizon(number)
        start, ensemble = self._started(horizon), self.ensemble.until(horizon)
        size = self.schedule.minibatch
        if size is not None and size < len(ensemble):
            chosen = torch.randperm(len(ensemble), generator=generator)[:size].sort().values
            ensemble = ensemble.select(chosen.tolist())
            start = map_tensors(lambda leaf: leaf[chosen], start)
        return ensemble, start

    def _slope(self, number: int) -> Slope:
        generator = self._generator(number)
        ensemble, start = self._members(number, generator)
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

    def _judge(self, start: Any) -> Judge:
        aim = self.objective
        return Judged(lambda trajectory: aim(aim.measure(trajectory), start), aim.recording)

    def _started(self, horizon: float | None) -> Any:
        """What the constants one starts from are measured to be, for every member."""
        if horizon not in self._start:
            aim = self.objective
            with torch.no_grad():
                run = self.ensemble.until(horizon).run({}, recording=aim.recording)
                found = aim.measure(run)
            if not all(bool(torch.isfinite(leaf).all()) for leaf in leaves(found)):
                raise SolverError("a member diverges, or is NaN, with the constants to start from")
            self._start[horizon] = found
        return self._start[horizon]

    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain numbers only, for `torch.load(weights_only=True)`."""
        return {
            "z": self.z.detach().clone(),
            "optimizer": {} if self._optimizer is None else self._optimizer.state_dict(),
            "history": self.history,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a saved state. Raises `ConfigError` where it does not fit, `KindError`."""
        if not {"z", "optimizer", "history"} <= set(instance("state", state, dict)):
            raise ConfigError("state: give what `state_dict` gave, z, optimizer and history")
        several("history", instance("history", state["history"], list), dict)
        if instance("z", state["z"], Tensor).shape != self.z.shape:
            raise ConfigError(
                f"checkpoint of {len(state['z'])} coordinates, this run has {len(self.z)}"
            )
        with torch.no_grad():
            self.z.copy_(state["z"])
        if self._optimizer is not None:
            try:
                self._optimizer.load_state_dict(state["optimizer"])
            except (KeyError, TypeError, ValueError, AttributeError) as error:
                raise ConfigError(f"state: its optimizer does not fit: {error!r}") from None
        self.history = list(state["history"])
