"""Controllers and policies on one plant: what either is to an environment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from ..checks import flag, function, instance, whole, wrong
from ..deployment import Stepper
from ..errors import ConfigError, ShapeError
from .extras import extra


class Policy(Protocol):
    """(observation, state) -> (action, state); the state is None where an episode begins.

    Stable-Baselines3's `model.predict` is one.
    """

    def __call__(self, observation: Any, state: Any) -> tuple[Any, Any]:
        """An action (m,) for an observation (n,)."""


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
        """Root mean square of the errors (p,), in the outputs' units, as `mann_torch.srmse`."""
        return np.sqrt(np.square(self.errors).mean(axis=0))


def as_policy(
    stepper: Stepper,
    env: Any,
    *,
    weights: Any = None,
    state: Tensor | None = None,
    adapt: bool = True,
) -> Policy:
    """A deployed controller as a policy of this `PlantEnv`, of its own period.

    At an episode's start its state is `state`, one of its own from elsewhere, or the initial one,
    of initial adaptive `weights` if they are given. Without `adapt` it does not learn. It reads
    what the environment itself shows: wrappers may change actions and rewards alone. Raises
    `ConfigError` where periods differ or the environment's reference lacks derivatives,
    `ShapeError` where numbers of measurement, reference and input do, `KindError`.
    """
    from .plant_env import PlantEnv

    ports = instance("stepper", stepper, Stepper).ports
    plain = instance("env", getattr(env, "unwrapped", env), PlantEnv)
    layout, period = plain.layout, plain.period
    start, adapt = start_of(stepper, weights, state), flag("adapt", adapt)
    if abs(stepper.period - period) > 1e-9 * period:
        raise ConfigError(
            f"period = {period} s of the environment: the controller's is {stepper.period} s"
        )
    if ports.order > layout.order:
        raise ConfigError(
            f"reference_order = {layout.order} of the environment: the controller asks for "
            f"{ports.order} derivatives"
        )
    given = (sum(layout.widths), layout.n_outputs, *plain.action_space.shape)
    own = (sum(ports.widths), ports.width, len(ports.input))
    if given != own:
        raise ShapeError(
            "an environment of {} measured numbers, {} outputs and {} inputs got a controller of "
            "{}, {} and {}".format(*given, *own)
        )

    def policy(observation: Any, state: Any) -> tuple[Any, Any]:
        row = torch.from_numpy(np.array(observation, float)).to(stepper.dtype)
        reference, measurement = layout.split(row)
        if state is None:
            state = start(reference, measurement)
        u, state = stepper(state, reference, measurement, adapt)
        return u.double().numpy(), state

    return policy


def start_of(stepper: Stepper, weights: Any, state: Tensor | None) -> Callable[[Any, Any], Tensor]:
    """What a deployed controller starts from, of reference and measurement then.

    Raises `ConfigError` for weights beside a state, or those that do not fit, and as `unpacked`.
    """
    if state is None:
        stepper.tick.controller.check_weights(weights)
        return partial(stepper.initial_state, weights=weights)
    if weights is not None:
        raise ConfigError("weights beside a state: it holds its own")
    stepper.unpacked(state)
    return lambda reference, measurement: state


def pair_of(given: Any) -> tuple[Any, Any]:
    """Action and state that a policy gave. Raises `KindError` for anything else."""
    if not isinstance(given, tuple) or len(given) != 2:
        raise wrong("what the policy gave", given, "(action, state), the state None without one")
    return given


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
        action, state = pair_of(policy(seen, state))
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
