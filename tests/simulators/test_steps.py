"""Steps of environments: compiled or not, the numbers are the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mann_torch as mt
from mann_torch.plants import DoubleIntegrator, PlanarQuadrotor
from mann_torch.signals import Disturbance, SquareWave, Steps
from tests.simulators.test_plant_env import cart

pytest.importorskip("gymnasium", reason="an extra: pip install mann_torch[simulators]")

from mann_torch.simulators import PlantEnv, PlantVectorEnv

QUADROTOR = PlanarQuadrotor()


def windy(random: np.random.Generator) -> mt.Scenario:
    """All that there is: jumps of reference, wind and mass at times of their own, and noise."""
    gust = Steps([float(random.uniform(0.05, 0.5))], [[1.0], [3.0]])
    return mt.Scenario(
        SquareWave([0.5] * 3, period=float(random.uniform(0.1, 2.0))),
        QUADROTOR.parameters_of(),
        float(random.uniform(0.1, 0.2)),
        noise=mt.MeasurementNoise([1e-3, 1e-2], int(random.integers(1000))),
        disturbance=Disturbance(plant=gust),
    )


def test_compiled_steps_are_those_of_torch() -> None:
    parts = {
        "sensor": mt.Sensor(delay=0.04, period=0.01),
        "actuator": mt.Actuator(3, limit=30.0, lag=0.05),
        "model": mt.SecondOrderModel(3, 3.0),
        "hold": "first",
        "divergence_limit": 12.0,
    }
    envs = [
        PlantVectorEnv(5, QUADROTOR, windy, 0.02, engine=engine, **parts)
        for engine in ("compiled", "torch")
    ]
    for env in envs:
        env.reset(seed=3)
    random, ended = np.random.default_rng(0), np.zeros(2)
    for _ in range(30):
        u = random.normal(5.0, 8.0, (5, 3))
        one, other = (env.step(u) for env in envs)
        for a, b in zip(one[:4], other[:4], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
        ended += [one[2].sum(), one[3].sum()]
    assert ended.min() >= 3  # horizons, and those that are held where they fell
    assert envs[0].engine_reason is None and envs[1].engine_reason == "asked for"


class Looking(DoubleIntegrator):
    """Decides on its data."""

    def load(self, q: Any, qd: Any, coefficients: Any) -> Any:
        return 0.0 * q if float(q[0]) < 1e3 else q


def test_what_cannot_be_traced_runs_in_torch_and_says_why() -> None:
    given = cart(plant=Looking())
    env = PlantEnv(**given | {"engine": "auto"})
    env.reset(seed=0)
    before = env.step(np.ones(1))[0]
    plain = PlantEnv(**cart())
    plain.reset(seed=0)
    np.testing.assert_allclose(before, plain.step(np.ones(1))[0], rtol=1e-12)
    assert env.engine_reason is not None and "float(q[0])" in env.engine_reason
    env = PlantEnv(**given | {"engine": "compiled"})
    env.reset(seed=0)
    with pytest.raises(mt.ConfigError, match=r"engine = .compiled.: .*; take .torch."):
        env.step(np.ones(1))
    with pytest.raises(mt.ConfigError, match="engine = 'warp': choose from auto"):
        PlantEnv(**given | {"engine": "warp"})
