"""docs/simulators.md does what it says: its code runs as printed, and its figures hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.plants import DoubleIntegrator
from tests.pages import executed

pytest.importorskip("gymnasium", reason="an extra: pip install mann_torch[simulators]")
pytest.importorskip("mujoco", reason="an extra: pip install mann_torch[simulators]")


from mann_torch.simulators import PlantEnv, run_episode


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    torch.set_num_threads(1)
    return executed("simulators.md")


def test_controller_and_policy_meet_one_plant(page: dict[str, Any]) -> None:
    assert page["apart"] <= 1e-9
    assert not bool(page["run"].status)
    errors = np.abs(page["episode"].errors).max(axis=0)
    assert (errors > 1e-3).all() and (errors < 0.5).all()
    # The policy is no worse made than it can be without the arm's equations: it sags.
    assert page["other"].srmse.max() > 1.5 * page["episode"].srmse.max()
    assert page["other"].total < page["episode"].total < 0.0


def test_draws_follow_from_the_seed(page: dict[str, Any]) -> None:
    assert np.array_equal(page["first"], page["again"])
    assert not np.array_equal(page["first"], page["another"])
    assert page["seen"].shape == (64, 10) and page["reward"].shape == (64,)


def test_observations_are_converted_and_engines_told(page: dict[str, Any]) -> None:
    envs, cell = page["envs"], page["cell"]
    assert page["seen"].dtype == np.float64 and page["actions"].dtype == torch.float32
    assert page["actions"].shape == envs.action_space.shape
    with pytest.raises(mt.DtypeError, match=r"x is torch\.float64, this cell takes torch\.float32"):
        cell(torch.as_tensor(page["seen"]))
    assert (envs.engine, envs.engine_reason) == ("compiled", None)


def test_the_default_period_is_the_one_that_is_told_and_the_last_one_may_be_short() -> None:
    plant = DoubleIntegrator()
    scenario = mt.Scenario(mt.Sinusoid([1.0]), plant.parameters_of(), horizon=0.025)
    env = PlantEnv(plant, scenario)
    run = run_episode(env, lambda seen, state: (np.ones(1), state))
    np.testing.assert_allclose(run.t, [0.0, 0.01, 0.02, 0.025], rtol=0, atol=1e-12)


def test_mujoco_agrees(page: dict[str, Any]) -> None:
    ours = mt.srmse(page["run"])  # of the same period, and never at its limits
    assert float(page["found"].u.abs().max()) < 200.0
    torch.testing.assert_close(page["found"].srmse, ours, rtol=0.02, atol=0)
    assert page["found"].stopped_at is None and not bool(page["found"].flags.any())


def test_the_crane_is_held(page: dict[str, Any]) -> None:
    crane = page["crane"]
    assert len(crane.t) == 1001 and float(crane.t[-1]) == pytest.approx(1.0)
    assert float(crane.error[100:].abs().max()) < 0.1
