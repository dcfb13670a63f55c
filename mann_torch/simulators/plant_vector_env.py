"""Many plants as one Gymnasium environment: a batch in one call of torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import instance, whole, wrong
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
AutoresetMode = gymnasium.vector.AutoresetMode


class PlantVectorEnv(Shown, gymnasium.vector.VectorEnv):
    """`num_envs` episodes of a `PlantEnv` side by side, each at its own time.

    Episode for episode the numbers are those of `num_envs` environments of their own: environment
    i draws from a generator of its own, of seed + i. `autoreset_mode` is Gymnasium's; infos hold
    what a `PlantEnv` says, with leading B. Other arguments and errors are a `PlantEnv`'s.
    """

    def __init__(
        self,
        num_envs: int,
        plant: Plant,
        scenario: Tasks,
        period: float = 0.01,
        *,
        autoreset_mode: Any = AutoresetMode.NEXT_STEP,
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
        self.num_envs = whole("num_envs", num_envs)
        self._mode = instance("autoreset_mode", autoreset_mode, AutoresetMode)
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self._world = World(
            plant, scenario, period, actuator=actuator, sensor=sensor, model=model, hold=hold,
            solver=solver, reward=reward, reference_order=reference_order,
            divergence_limit=divergence_limit, engine=engine,
        )  # fmt: skip
        self._episodes: Episodes | None = None
        self._random = [np.random.default_rng() for _ in range(self.num_envs)]
        box, batch = gymnasium.spaces.Box, gymnasium.vector.utils.batch_space
        self.single_action_space = box(*self._world.bounds(), dtype=np.float64)
        self.single_observation_space = box(-np.inf, np.inf, (len(self.names),), np.float64)
        self.action_space = batch(self.single_action_space, self.num_envs)
        self.observation_space = batch(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Any = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes, those of `options["reset_mask"]` (B,) bool alone if it is given."""
        count = self.num_envs
        chosen = np.ones(count, dtype=bool)
        if options is not None and "reset_mask" in options:
            chosen = np.asarray(options["reset_mask"])
            if chosen.shape != (count,) or chosen.dtype != bool:
                raise wrong("reset_mask", options["reset_mask"], f"({count},) of True and False")
        seeds: list[int | None] = [None] * count
        if isinstance(seed, Sequence):
            seeds = list(seed)
        elif seed is not None:
            seeds = [whole("seed", seed, 0) + i for i in range(count)]
            # For wrappers: none of the environments' own.
            self._np_random, self._np_random_seed = np.random.default_rng([seed, count]), seed
        if len(seeds) != count:
            raise ConfigError(f"seed: {len(seeds)} of them, there are {count} environments")
        for i in chosen.nonzero()[0]:
            if seeds[i] is not None:
                self._random[i] = gymnasium.utils.seeding.np_random(seeds[i])[0]
        if self._episodes is None and not chosen.all():
            raise ConfigError("reset_mask: reset all environments first")
        self._begin(chosen)
        now = self._begun().now
        return self.layout.flat(now).numpy().copy(), infos_of(now, chosen)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Hold inputs (B, m) for a period, in every environment."""
        u, episodes = inputs_of(actions, self.action_space.shape), self._begun()
        ended = episodes.over | episodes.now.diverged
        if bool(ended.any()) and self._mode is not AutoresetMode.NEXT_STEP:
            raise ConfigError("an episode is over: call reset() with a reset_mask")
        moment = episodes.advance(u, ~ended)
        rewards = np.where(ended.numpy(), 0.0, self._world.rewards(moment))
        terminated = (moment.diverged & ~ended).numpy().copy()
        truncated = (episodes.over & ~moment.diverged & ~ended).numpy().copy()
        everyone, over = np.ones(self.num_envs, dtype=bool), terminated | truncated
        infos: dict[str, Any] = {}
        again = ended.numpy()
        if self._mode is AutoresetMode.SAME_STEP and over.any():
            last = np.full(self.num_envs, None, dtype=object)
            for i in over.nonzero()[0]:
                last[i] = self.layout.flat(moment)[i].numpy().copy()
            infos = {"final_obs": last, "final_info": infos_of(moment, over)}
            infos |= {"_final_obs": over.copy(), "_final_info": over.copy()}
            again = over
        if again.any():
            self._begin(again)
        now = self._begun().now
        return (
            self.layout.flat(now).numpy().copy(), rewards, terminated, truncated,
            {**infos_of(now, everyone), **infos},
        )  # fmt: skip

    def _begun(self) -> Episodes:
        if self._episodes is None:
            raise ConfigError("no episode has begun: call reset()")
        return self._episodes

    def _begin(self, chosen: Any) -> None:
        """New episodes in some environments (B,) bool."""
        world, places = self._world, chosen.nonzero()[0].tolist()
        drawn = [world.drawn(self._random[i]) for i in places]
        if self._episodes is None:
            self._episodes = world.begun(drawn)
        else:
            self._episodes.begin(places, drawn)


def infos_of(moment: Moment, there: Any) -> dict[str, Any]:
    """What a `PlantEnv` says, of all environments, and of which it counts."""
    rows = {"t": moment.t, "error": moment.error, "output": moment.seen.output}
    rows["applied"] = moment.seen.applied
    said = {name: x.numpy().copy() for name, x in rows.items()}
    return {**said, **{f"_{name}": there.copy() for name in rows}}
