"""Controllers and policies on one plant: what either is to an environment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from ..checks import function, instance, whole, wrong
from ..errors import ConfigError
from .extras import extra


class Policy(Protocol):
    """(observation, state) -> (action, state); the state is None where an episode begins.

    Stable-Baselines3's `model.predict` is one.
    """

    def __call__(self, observation: Any, state: Any) -> tuple[Any, Any]:
        """An action (m,) for an observation (n,)."""


class Ticked(Protocol):
    """A deployed controller: state in, state out, a tick a call (`mann_torch.deploy`)."""

    def initial_state(self, reference: Any, measurement: Any) -> Any:
        """Before the first tick."""

    def __call__(self, state: Any, reference: Any, measurement: Any) -> tuple[Tensor, Any]:
        """The input (m,), and the state after the tick."""


@dataclass(frozen=True)
class Run:
    """An episode, a row a period: what was seen and done, and what came of it."""

    t: Any  # (P + 1,) [s], the last at the end
    observations: Any  # (P + 1, n)
    actions: Any  # (P, m)
    rewards: Any  # (P,)
    errors: Any  # (P + 1, p)
    terminated: bool  # it diverged

    @property
    def total(self) -> float:
        """Of all rewards."""
        return float(self.rewards.sum())

    @property
    def srmse(self) -> Any:
        """Root mean square of the error at the starts of periods (p,), in the outputs' units."""
        return np.sqrt(np.square(self.errors[:-1]).mean(axis=0))


def as_policy(stepper: Ticked, env: Any) -> Policy:
    """A deployed controller as a policy of this environment, of its own period.

    Raises `ConfigError` where the environment's period is another, `KindError`.
    """
    from .plant_env import PlantEnv

    world = instance("env", getattr(env, "unwrapped", env), PlantEnv)
    layout, period = world.layout, world.period
    if not callable(stepper) or not hasattr(stepper, "initial_state"):
        raise wrong("stepper", stepper, "a deployed controller")
    own = getattr(stepper, "period", period)
    if abs(own - period) > 1e-9 * period:
        raise ConfigError(f"period = {period} s of the environment: the controller's is {own} s")

    def policy(observation: Any, state: Any) -> tuple[Any, Any]:
        reference, measurement = layout.split(torch.from_numpy(np.array(observation, float)))
        if state is None:
            state = stepper.initial_state(reference, measurement)
        u, state = stepper(state, reference, measurement)
        return u.detach().numpy(), state

    return policy


def run_episode(env: Any, policy: Policy, seed: int | None = None) -> Run:
    """One episode of a `PlantEnv` (wrapped or not) under a policy. Raises `KindError`."""
    instance("env", env, extra("gymnasium").Env, "a Gymnasium environment")
    function("policy", policy)
    if seed is not None:
        seed = whole("seed", seed, 0)
    seen, info = env.reset(seed=seed)
    observations, told, actions, rewards = [seen], [info], [], []
    state, terminated, truncated = None, False, False
    while not (terminated or truncated):
        action, state = policy(seen, state)
        seen, reward, terminated, truncated, info = env.step(action)
        observations.append(seen)
        told.append(info)
        actions.append(np.asarray(action))
        rewards.append(reward)
    return Run(
        t=np.array([row["t"] for row in told]),
        observations=np.stack(observations),
        actions=np.stack(actions),
        rewards=np.array(rewards),
        errors=np.stack([row["error"] for row in told]),
        terminated=terminated,
    )
