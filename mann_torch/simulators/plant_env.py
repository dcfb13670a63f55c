"""A plant as a Gymnasium environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import torch

from ..errors import ConfigError
from ..parts import Actuator, ReferenceModel, Sensor
from ..plants import Plant
from ..simulation import Solver
from .episodes import Episodes, Moment
from .extras import extra
from .world import Reward, Shown, Tasks, World, inputs_of

if TYPE_CHECKING:
    import gymnasium
else:
    gymnasium = extra("gymnasium")


class PlantEnv(Shown, gymnasium.Env):
    """Any plant that follows a reference, under inputs held over a `period` [s].

    An episode is a scenario: its reference, parameters, schedule, disturbance, noise, start and
    horizon, the same each time; a function of a NumPy generator draws one at each `reset`. What
    happens within a period is what `rollout` does in a loop with `Clock(period, hold=hold)`, same
    solver and same grid of steps, so that a controller of that period meets the same plant.

    - action (m,): the plant's input; where there is an `actuator`, what is commanded, and its
      limits are the space's
    - observation (n,), float64: what is measured, by a `sensor` if there is one, then the
      reference, or a reference `model`'s output, and its first `reference_order` derivatives (as
      many as it has, 2 at most, if not given); `names` says which number is which
    - reward: minus the error's square at the period's end; a divergence costs that of all periods
      left, too. `reward` is a function of a `Moment` (B, ...) that gives (B,) instead
    - terminated: a state beyond `divergence_limit`, or not finite; truncated: the horizon
    - info: time `t` [s], `error` and `output` (p,), `applied` input (m,)

    `engine` is ``auto``, ``compiled`` or ``torch``, as `rollout` has it: the first step compiles.
    Neither scenarios nor parts are to be changed once they were given; a function is asked once
    beforehand, for the sizes of what it gives.

    Raises `ConfigError` or a subclass of it, as `rollout` does, for what does not fit, and for an
    action that is not finite or of another shape.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        plant: Plant,
        scenario: Tasks,
        period: float = 0.01,
        *,
        actuator: Actuator | None = None,
        sensor: Sensor | None = None,
        model: ReferenceModel | None = None,
        hold: str = "zero",
        solver: Solver | None = None,
        reward: Reward | None = None,
        reference_order: int | None = None,
        divergence_limit: float = 1e8,
        engine: str = "auto",
    ) -> None:
        self._world = World(
            plant, scenario, period, actuator=actuator, sensor=sensor, model=model, hold=hold,
            solver=solver, reward=reward, reference_order=reference_order,
            divergence_limit=divergence_limit, engine=engine,
        )  # fmt: skip
        self._episodes: Episodes | None = None
        low, high = self._world.bounds()
        self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        wide = (len(self.layout.names),)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, wide, np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode: observation and info. A seed begins the row of draws anew."""
        super().reset(seed=seed)
        episode = self._world.drawn(self.np_random)
        if self._episodes is None:
            self._episodes = self._world.begun([episode])
        else:
            self._episodes.begin([0], [episode])
        moment = self._episodes.now
        return self.layout.flat(moment)[0].numpy().copy(), info_of(moment, 0)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Hold the input for a period: observation, reward, terminated, truncated, info."""
        u = inputs_of(action, self.action_space.shape)
        episodes = self._episodes
        if episodes is None or bool(episodes.over | episodes.now.diverged):
            raise ConfigError("the episode is over, or none has begun: call reset()")
        moment = episodes.advance(u.unsqueeze(0), torch.ones(1, dtype=torch.bool))
        observation = self.layout.flat(moment)[0].numpy().copy()
        terminated = bool(moment.diverged)
        truncated = bool(episodes.over) and not terminated
        reward = float(self._world.rewards(moment)[0])
        return observation, reward, terminated, truncated, info_of(moment, 0)


def info_of(moment: Moment, i: int) -> dict[str, Any]:
    """What an environment says beside its observation."""
    seen = moment.seen
    rows = {"error": moment.error, "output": seen.output, "applied": seen.applied}
    return {"t": float(moment.t[i]), **{n: x[i].numpy().copy() for n, x in rows.items()}}
