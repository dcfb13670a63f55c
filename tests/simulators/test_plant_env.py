"""A plant as a Gymnasium environment: what it does is what a rollout does."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.plants import PLANTS, DoubleIntegrator
from mann_torch.signals import Disturbance, Sinusoid, SquareWave
from tests.conftest import generator, make_controller, make_scenario

gymnasium = pytest.importorskip("gymnasium", reason="an extra: pip install mann_torch[simulators]")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from mann_torch.simulators import PlantEnv, as_policy, run_episode  # noqa: E402

PERIOD = 2e-3
#: What stands before the plant, and what else the scenario has.
LOOPS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "plain": ({}, {}),
    "on a line": ({}, {"hold": "first"}),
    "actuator": ({"actuator": mt.Actuator(2, limit=60.0, lag=0.01)}, {}),
    "model": ({"model": mt.SecondOrderModel(2, 8.0)}, {}),
    "sensor": (
        {"sensor": mt.Sensor(quantum=1e-3, delay=2e-3, period=1e-3)},
        {"noise": mt.MeasurementNoise([1e-4, 1e-3], 3, rate=300.0)},
    ),
    "pushed": (
        {},
        {"disturbance": Disturbance(input=SquareWave([3.0, 1.0], period=0.071))},
    ),
}


def cart(horizon: float = 0.5, **other: Any) -> dict[str, Any]:
    plant = DoubleIntegrator()
    scenario = mt.Scenario(Sinusoid([1.0], 2.0), plant.parameters_of(), horizon)
    given = {"plant": plant, "scenario": scenario, "period": 0.05, "engine": "torch"}
    return {**given, **other}


@pytest.mark.parametrize("kind", LOOPS)
def test_a_controller_meets_the_plant_of_a_rollout(kind: str) -> None:
    parts, other = LOOPS[kind]
    other = dict(other)
    hold = other.pop("hold", "zero")
    controller = make_controller("reallocating_always")
    controller.initialize(base_gain=8.0, robust_gain=2.0)
    weights = controller.initial_weights((), generator(1))
    # Jumps on a tick and between ticks, and a horizon that is no whole number of periods.
    scenario = dataclasses.replace(make_scenario(0.1211, (0.0431, 0.08)), **other)
    loop = mt.ClosedLoop(mt.TwoLinkArm(), controller, clock=mt.Clock(PERIOD, hold=hold), **parts)
    with torch.no_grad():
        run = mt.rollout(loop, scenario, weights=weights, sample_dt=PERIOD, engine="torch")
    assert not bool(run.status)
    env = PlantEnv(mt.TwoLinkArm(), scenario, PERIOD, hold=hold, engine="torch", **parts)
    deployed = mt.deploy(controller, PERIOD, engine="torch")
    episode = run_episode(env, as_policy(deployed, env, weights=weights), seed=0)
    at = torch.searchsorted(run.t, torch.from_numpy(episode.t) - 1e-9)
    assert len(episode.actions) == 61 and not episode.terminated
    np.testing.assert_allclose(episode.t, run.t[at].numpy(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(episode.errors, run.error[at].numpy(), rtol=0, atol=1e-9)
    assert np.abs(episode.errors).max() > 1e-2
    np.testing.assert_allclose(
        episode.rewards, -np.square(episode.errors[1:]).sum(-1), rtol=1e-12, atol=0
    )


@pytest.mark.parametrize("name", PLANTS)
def test_every_plant_is_an_environment(name: str) -> None:
    given = {"linear": {"A": [[-1.0]], "B": [[1.0]], "C": [[1.0]]}, "regression": {}}
    try:
        plant = PLANTS[name](**given.get(name, {}))
    except TypeError:
        pytest.skip("it takes arguments of its own")
    reference = Sinusoid([0.1] * len(plant.outputs), 1.0)
    scenario = mt.Scenario(reference, plant.parameters_of(), 1.0)
    limits = mt.Actuator(len(plant.inputs), limit=1.0)
    env = PlantEnv(plant, scenario, 0.02, actuator=limits, engine="torch")
    check_env(env, skip_render_check=True)
    run = run_episode(env, lambda seen, state: (env.action_space.sample(), state), seed=3)
    assert len(run.t) == 51 and np.isfinite(run.observations).all()
    measured = plant.measure(plant.rest(), plant.coefficients(plant.parameters_of()))
    width = sum(part.shape[-1] for part in measured)
    assert len(env.names) == width + 3 * len(plant.outputs)
    assert env.names[width] == "reference_value_1"


def drawn(random: np.random.Generator) -> mt.Scenario:
    """Another reference, mass, jump of it, and noise each time."""
    mass = float(random.uniform(0.5, 2.0))
    masses = mt.PiecewiseConstant([float(random.uniform(0.1, 0.3))], [[mass], [2.0 * mass]])
    return mt.Scenario(
        Sinusoid([float(random.uniform(0.5, 1.5))], 2.0),
        DoubleIntegrator().parameters_of(),
        0.4,
        schedule={"masses": masses},
        noise=mt.MeasurementNoise([0.01, 0.01], int(random.integers(1 << 31))),
    )


def test_a_seed_says_all_that_is_drawn() -> None:
    env = PlantEnv(**cart(scenario=drawn))
    push = lambda seen, state: (np.ones(1), state)  # noqa: E731
    runs = [run_episode(env, push, seed=seed) for seed in (5, None, None, 5, None, 6)]
    for one, other in ((0, 3), (1, 4)):
        np.testing.assert_array_equal(runs[one].observations, runs[other].observations)
    for one, other in ((0, 1), (1, 2), (0, 5)):
        assert np.abs(runs[one].observations - runs[other].observations).max() > 1e-3


def test_a_scenario_that_comes_again_is_as_it_was() -> None:
    """Whatever came between, of the same length."""
    random = np.random.default_rng(3)
    tasks = [drawn(random) for _ in range(3)]
    order = iter([0, 0, 1, 2, 0, 1])
    env = PlantEnv(**cart(scenario=lambda _: tasks[next(order)]))
    push = lambda seen, state: (np.ones(1), state)  # noqa: E731
    runs = [run_episode(env, push).observations for _ in range(5)]
    np.testing.assert_array_equal(runs[0], runs[3])
    np.testing.assert_array_equal(runs[1], runs[4])
    assert np.abs(runs[0] - runs[1]).max() > 1e-3


def test_a_divergence_ends_it_and_is_no_way_out() -> None:
    env = PlantEnv(**cart(5.0, divergence_limit=2.0))
    push = lambda seen, state: (5.0 * np.ones(1), state)  # noqa: E731
    run = run_episode(env, push, seed=0)
    assert run.terminated and len(run.rewards) < 20
    assert np.abs(run.observations[:, :2]).max() <= 2.0  # the last state within the limit
    last = np.square(run.errors[-1]).sum()
    assert run.rewards[-1] == pytest.approx(-last * (1 + 100 - len(run.rewards)), rel=1e-12)
    with pytest.raises(mt.ConfigError, match=r"call reset\(\)"):
        env.step(np.zeros(1))


def test_a_reward_of_ones_own_sees_the_moment() -> None:
    def effort(moment: Any) -> torch.Tensor:
        return -moment.seen.input.square().sum(-1)

    env = PlantEnv(**cart(reward=effort))
    run = run_episode(env, lambda seen, state: (2.0 * np.ones(1), state))
    np.testing.assert_allclose(run.rewards, -4.0, rtol=1e-14)
    with pytest.raises(mt.ConfigError, match=r"reward has shape \(\): must be \(1,\)"):
        run_episode(
            PlantEnv(**cart(reward=lambda moment: 1.0)),
            lambda seen, state: (np.zeros(1), state),
        )


@pytest.mark.parametrize("given", [np.ones(1), np.ones(2), 1.0, None, (np.ones(1),)])
def test_a_policy_that_gives_no_pair_is_told_so(given: Any) -> None:
    with pytest.raises(mt.KindError, match=r"what the policy gave = .*must be \(action, state\)"):
        run_episode(PlantEnv(**cart()), lambda seen, state: given)


def test_it_says_which_engine_takes_the_steps() -> None:
    env = PlantEnv(**cart())
    assert (env.engine, env.engine_reason) == ("torch", "asked for")
    env = PlantEnv(**cart(engine="auto"))
    assert (env.engine, env.engine_reason) == ("compiled", None)
    env.reset(seed=0)
    env.step(np.zeros(1))
    assert (env.engine, env.engine_reason) == ("compiled", None)


def test_gymnasiums_wrappers_fit() -> None:
    env = PlantEnv(**cart(1.0, actuator=mt.Actuator(1, limit=3.0)))
    wrapped = gymnasium.wrappers.RescaleAction(
        gymnasium.wrappers.TimeLimit(env, max_episode_steps=7), -1.0, 1.0
    )
    run = run_episode(wrapped, lambda seen, state: (np.ones(1), state))
    assert len(run.rewards) == 7 and not run.terminated
    np.testing.assert_allclose(env.step(np.zeros(1))[-1]["applied"], 0.0)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"solver": mt.Odeint("dopri5")}, "chooses its steps by data"),
        ({"period": 0.0}, "period = 0.0: must be finite and > 0"),
        ({"reference_order": 5}, "reference_order = 5: the reference has 4"),
        ({"hold": "third"}, "hold"),
        ({"scenario": 3}, "scenario = 3: must be a Scenario, or a function"),
        ({"scenario": lambda random: 3}, "scenario = 3: must be a Scenario"),
        ({"actuator": mt.Actuator(5, limit=1.0)}, "an actuator of 5"),
        ({"actuator": mt.Actuator(1, limit=[[1.0], [2.0]])}, r"have batch shape \(2,\)"),
    ],
)
def test_what_does_not_fit_is_named(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(mt.ConfigError, match=said):
        PlantEnv(**cart(**changed))


def test_a_batch_of_scenarios_is_no_episode() -> None:
    scenario = cart()["scenario"]
    with pytest.raises(mt.ShapeError, match=r"batch shape \(2,\): an episode is one task"):
        PlantEnv(**cart(scenario=mt.Scenario.stack([scenario, scenario])))


def test_actions_are_checked() -> None:
    env = PlantEnv(**cart())
    with pytest.raises(mt.ConfigError, match=r"call reset\(\)"):
        env.step(np.zeros(1))
    env.reset(seed=0)
    with pytest.raises(mt.ConfigError, match=r"action has shape"):
        env.step(np.zeros(2))
    with pytest.raises(mt.ConfigError, match="must be finite"):
        env.step(np.full(1, np.nan))


def test_a_controller_that_does_not_fit_is_refused() -> None:
    def deployed(period: float = PERIOD, **other: Any) -> mt.Stepper:
        return mt.deploy(make_controller("nn"), period, engine="torch", **other)

    def refused(said: str, stepper: Any, **given: Any) -> None:
        with pytest.raises(mt.ConfigError, match=said):
            as_policy(stepper, env, **given)

    env = PlantEnv(mt.TwoLinkArm(), make_scenario(), PERIOD)
    refused(r"period = 0.002 s of the environment: the controller's is 0.001 s", deployed(1e-3))
    refused("weights beside a state", deployed(), weights=3, state=torch.zeros(3))
    refused("shape", deployed(), state=torch.zeros(3, dtype=torch.float64))
    env = PlantEnv(mt.TwoLinkArm(), make_scenario(), PERIOD, reference_order=1)
    refused("reference_order = 1 of the environment: .* asks for 2", deployed())
    env = PlantEnv(**cart() | {"period": PERIOD})
    refused("of 2 measured numbers, 1 outputs and 1 inputs got .* of 4, 2 and 2", deployed())
