"""A plant, what stands before it and its tasks, checked: what both environments are made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..checks import ABOVE_0, POSITIVE, function, instance, number, whole, wrong
from ..errors import ConfigError, ShapeError
from ..parts import Actuator, Clock, ReferenceModel, Sensor
from ..plants import Plant
from ..simulation import ClosedLoop, Implicit, Scenario, Solver, check_engine
from ..trees import leaves
from ..types import MOST_DERIVATIVES, ReferenceSample
from .episode import Episode, episode_of
from .episodes import Episodes, Moment
from .given import GivenInput

#: One task for every episode, or a function that draws one.
Tasks = Scenario | Callable[[np.random.Generator], Scenario]
Reward = Callable[[Moment], Tensor]
#: Names of the reference's derivatives, in the order of a `ReferenceSample`.
DERIVATIVES = ReferenceSample._fields[: MOST_DERIVATIVES + 1]

#: Episodes that are kept in case they come again.
_MOST = 64


def squared_error(moment: Moment) -> Tensor:
    """Minus the error's square (B,); who diverges pays the last one for all periods left, too."""
    cost = moment.error.square().sum(-1)
    return -torch.where(moment.diverged, cost * (1 + moment.left), cost)


class Layout(NamedTuple):
    """Where things are in an observation: the measurement's numbers, then the reference's."""

    measured: type  # NamedTuple of the measurement
    widths: tuple[int, ...]  # of its fields
    n_outputs: int
    order: int  # derivatives of the reference

    @property
    def names(self) -> tuple[str, ...]:
        """Of each number, `qd_1` say, or `reference_rate_2`."""
        fields: tuple[str, ...] = self.measured._fields  # type: ignore[attr-defined]
        found = [(name, width) for name, width in zip(fields, self.widths, strict=True)]
        found += [(f"reference_{n}", self.n_outputs) for n in DERIVATIVES[: self.order + 1]]
        return tuple(f"{name}_{i + 1}" for name, width in found for i in range(width))

    def flat(self, moment: Moment) -> Tensor:
        """Observations (B, n)."""
        parts = [*leaves(moment.seen.measurement), *moment.seen.reference.upto(self.order)]
        return torch.cat([part.expand(*moment.t.shape, part.shape[-1]) for part in parts], dim=-1)

    def split(self, observation: Tensor) -> tuple[ReferenceSample, Any]:
        """Reference and measurement in observations (..., n), as a controller takes them."""
        width = sum(self.widths)
        measured = self.measured(*observation[..., :width].split(list(self.widths), dim=-1))
        parts = observation[..., width:].split(self.n_outputs, dim=-1)
        return ReferenceSample(*parts), measured


class World:
    """A plant under inputs that are held over a `period` [s], and the tasks it is given.

    Raises as `PlantEnv`.
    """

    def __init__(
        self,
        plant: Plant,
        scenario: Tasks,
        period: float,
        *,
        actuator: Actuator | None,
        sensor: Sensor | None,
        model: ReferenceModel | None,
        hold: str,
        solver: Solver | None,
        reward: Reward | None,
        reference_order: int | None,
        divergence_limit: float,
        engine: str,
    ) -> None:
        inputs = len(instance("plant", plant, Plant).inputs)
        self.period = number("period", period, POSITIVE)
        clock = Clock(self.period, hold=hold)
        self.loop = ClosedLoop(plant, GivenInput(inputs), actuator, sensor, clock, model)
        self.solver = Implicit() if solver is None else instance("solver", solver, Solver)
        if not self.solver.fuses_step:
            raise ConfigError(
                f"solver {self.solver.name} chooses its steps by data, and episodes side by side "
                "are each at their own time: take Implicit or RungeKutta"
            )
        if not isinstance(scenario, Scenario) and not callable(scenario):
            raise wrong("scenario", scenario, "a Scenario, or a function that gives one")
        if reward is not None:
            function("reward", reward)
        self._scenario, self._reward = scenario, squared_error if reward is None else reward
        self.limit = number("divergence_limit", divergence_limit, ABOVE_0)
        self._known: dict[int, tuple[Scenario, Episode]] = {}
        shape = tuple(self.loop.batch_shape())
        if shape:
            raise ShapeError(f"constants of actuator, sensor or model have batch shape {shape}")
        # A function is asked once, for the sizes of what it gives.
        first = self.drawn(np.random.default_rng(0))
        ((example, _),) = self._known.values()
        self.obstacle = check_engine(self.loop, example, self.solver, engine)
        self._insisted = engine == "compiled"
        moment = Episodes(self.loop, self.solver, [first], self.limit).now
        measured, sample = moment.seen.measurement, moment.seen.reference
        offered = sum(part is not None for part in sample.parts) - 1
        order = min(2, offered)
        if reference_order is not None:
            order = whole("reference_order", reference_order, 0)
            if order > offered:
                raise ConfigError(f"reference_order = {order}: the reference has {offered}")
        widths = tuple(part.shape[-1] for part in measured)
        self.layout = Layout(type(measured), widths, len(plant.outputs), order)

    def drawn(self, random: np.random.Generator) -> Episode:
        """The next episode; a scenario that has been there before is not laid out again."""
        given = self._scenario
        wanted = "a Scenario, or a function that gives one"
        scenario = given if isinstance(given, Scenario) else given(random)
        found = self._known.get(id(instance("scenario", scenario, Scenario, wanted)))
        if found is None:
            if len(self._known) >= _MOST:
                self._known.clear()
            with torch.no_grad():
                found = scenario, episode_of(self.loop, scenario, self.solver)
            self._known[id(scenario)] = found
        return found[1]

    def begun(self, episodes: Sequence[Episode]) -> Episodes:
        """Episodes side by side, at their start."""
        return Episodes(self.loop, self.solver, episodes, self.limit, self.obstacle, self._insisted)

    def rewards(self, moment: Moment) -> np.ndarray[Any, np.dtype[np.float64]]:
        """(B,). Raises `ConfigError` for a reward that is not one number an episode."""
        with torch.no_grad():
            found = torch.as_tensor(self._reward(moment), dtype=torch.float64)
        if found.shape != moment.t.shape:
            raise ConfigError(
                f"reward has shape {tuple(found.shape)}: must be {tuple(moment.t.shape)}, one "
                "number an episode"
            )
        return found.numpy().copy()

    def bounds(self) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Least and largest inputs (m,): an actuator's limits, none without one."""
        m, found = len(self.loop.plant.inputs), []
        for name, none in (("lower", -np.inf), ("upper", np.inf)):
            actuator, row = self.loop.actuator, np.full(m, none)
            if actuator is not None and name in actuator.domains():
                row[:] = getattr(actuator, name).detach().numpy()
            found.append(row)
        return found[0], found[1]


def inputs_of(action: Any, shape: tuple[int, ...]) -> Tensor:
    """An action as inputs. Raises `ConfigError` for another shape, or what is not finite."""
    given = np.asarray(action, dtype=np.float64)
    if given.shape != shape:
        raise ConfigError(f"action has shape {given.shape}: must be {shape}")
    if not np.isfinite(given).all():
        raise ConfigError(f"action = {given.tolist()}: must be finite")
    return torch.from_numpy(given.copy())


class Shown:
    """What both environments show of their world."""

    _world: World
    _episodes: Episodes | None

    @property
    def period(self) -> float:
        """For which an input is held [s]."""
        return self._world.period

    @property
    def engine_reason(self) -> str | None:
        """Why steps run in eager torch; None where they are compiled."""
        return self._world.obstacle if self._episodes is None else self._episodes.steps.obstacle

    @property
    def engine(self) -> str:
        """What takes the steps, "compiled" or "torch"; the first of them may change it."""
        return "compiled" if self.engine_reason is None else "torch"

    @property
    def layout(self) -> Layout:
        """Where things are in an observation."""
        return self._world.layout

    @property
    def names(self) -> tuple[str, ...]:
        """Of an observation's numbers."""
        return self.layout.names
