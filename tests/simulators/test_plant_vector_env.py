"""Plants side by side: each as if it were alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from torch.utils._python_dispatch import TorchDispatchMode

import mann_torch as mt
from tests.simulators.test_plant_env import cart, drawn

gymnasium = pytest.importorskip("gymnasium", reason="an extra: pip install mann_torch[simulators]")
from gymnasium.vector import AutoresetMode, SyncVectorEnv  # noqa: E402

from mann_torch.simulators import PlantEnv, PlantVectorEnv  # noqa: E402

COUNT, STEPS = 5, 18
#: Random pushes throw some beyond this limit in the middle of an episode of 8 periods.
LIMIT = 1.2


def alike(one: Any, other: Any) -> None:
    """To rounding: sums over batches of other sizes come out different in the last bit."""
    assert one.dtype == other.dtype and one.shape == other.shape
    if one.dtype == object:
        for a, b in zip(one, other, strict=True):
            assert (a is None) == (b is None)
            if a is not None:
                alike(a, b)
    else:
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("scenario", ["drawn", "the same"])
def test_it_is_gymnasiums_row_of_environments(mode: Any, scenario: str) -> None:
    given = cart(0.4, divergence_limit=LIMIT)
    if scenario == "drawn":
        given["scenario"] = drawn
    ours = PlantVectorEnv(COUNT, **given, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: PlantEnv(**given)] * COUNT, autoreset_mode=mode)
    random = np.random.default_rng(0)
    for one, other in zip(ours.reset(seed=7), theirs.reset(seed=7), strict=True):
        if isinstance(one, dict):
            assert set(one) == set(other)
        else:
            alike(one, other)
    ended = {"terminated": 0, "truncated": 0}
    for _ in range(STEPS):
        actions = random.normal(0.0, 9.0, (COUNT, 1))
        one, other = ours.step(actions), theirs.step(actions)
        for a, b in zip(one[:4], other[:4], strict=True):
            alike(a, b)
        ended["terminated"] += int(one[2].sum())
        ended["truncated"] += int(one[3].sum())
        assert set(one[4]) == set(other[4])
        alike(one[4]["t"], other[4]["t"])
        if "final_obs" in one[4]:
            alike(one[4]["final_obs"], other[4]["final_obs"])
            over = one[4]["_final_obs"]
            assert np.array_equal(over, other[4]["_final_obs"])
            final, known = one[4]["final_info"], other[4]["final_info"]
            assert set(final) == set(known)
            alike(final["error"][over], known["error"][over])
    assert min(ended.values()) >= 3, ended
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space


def test_some_are_reset_by_hand() -> None:
    env = PlantVectorEnv(3, **cart(0.2), autoreset_mode=AutoresetMode.DISABLED)
    with pytest.raises(mt.ConfigError, match=r"call reset\(\)"):
        env.step(np.zeros((3, 1)))
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.ones((3, 1)))
    mask = np.array([False, True, False])
    _, infos = env.reset(options={"reset_mask": mask})
    np.testing.assert_allclose(infos["t"], [0.1, 0.0, 0.1], atol=1e-12)
    assert np.array_equal(infos["_t"], mask)
    for _ in range(2):
        _, _, _, truncated, infos = env.step(np.ones((3, 1)))
    assert truncated.tolist() == [True, False, True]
    with pytest.raises(mt.ConfigError, match="an episode is over"):
        env.step(np.ones((3, 1)))
    with pytest.raises(mt.ConfigError, match="reset_mask"):
        env.reset(options={"reset_mask": [1, 0, 0]})


def test_scenarios_side_by_side_are_alike() -> None:
    plain, turn = cart()["scenario"], []

    def other(random: np.random.Generator) -> mt.Scenario:
        turn.append(0)
        noise = mt.MeasurementNoise([0.1, 0.1]) if len(turn) % 2 else None
        return mt.Scenario(plain.reference, plain.parameters, 0.5, noise=noise)

    with pytest.raises(mt.ConfigError, match="all with noise, or none"):
        PlantVectorEnv(2, **cart(scenario=other)).reset(seed=0)


class Counted(TorchDispatchMode):
    """Calls of torch."""

    def __init__(self) -> None:
        super().__init__()
        self.calls = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.calls += 1
        return func(*args, **(kwargs or {}))


def test_a_batch_costs_what_one_does() -> None:
    calls = []
    for count in (1, 40):
        env = PlantVectorEnv(count, **cart())
        env.reset(seed=0)
        with Counted() as counted:
            env.step(np.zeros((count, 1)))
        calls.append(counted.calls)
    assert 0 < calls[1] < 1.1 * calls[0]
