"""docs/reinforcement.md, run as printed: a policy with a memory learns what to remember."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from tests.pages import executed

gymnasium = pytest.importorskip("gymnasium", reason="an extra: pip install mann_torch[simulators]")

from mann_torch.simulators import PlantVectorEnv  # noqa: E402


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    torch.set_num_threads(1)
    return executed("reinforcement.md")


def test_the_policy_beats_whoever_does_not_remember(page: dict[str, Any]) -> None:
    """In rollouts of 15 steps of episodes of 7: what is remembered goes over from one to the next.

    Begun anew in each, three quarters of pushes are right at most.
    """
    assert np.mean(page["won"][:5]) < 0.5
    assert np.mean(page["won"][-5:]) > 0.9  # of 1; without a memory 1/3


@pytest.mark.parametrize(
    ("steps", "iterations", "right"),
    [
        pytest.param(20, 100, (0.95, 1.0), marks=pytest.mark.slow),
        pytest.param(10, 100, (0.5, 1.0), marks=pytest.mark.slow),
        (5, 40, (0.2, 0.5)),  # never the glimpse and its push in one rollout
    ],
)
def test_other_lengths_do_what_the_page_says(
    page: dict[str, Any], steps: int, iterations: int, right: tuple[float, float]
) -> None:
    _, won = page["learned"](steps, iterations)
    assert right[0] <= np.mean(won[-5:]) <= right[1]


def environment(page: dict[str, Any], mode: str) -> Any:
    mode = getattr(gymnasium.vector.AutoresetMode, mode)
    return page["Glimpse"](
        PlantVectorEnv(
            3,
            page["slider"],
            page["task"],
            period=1.0,
            solver=mt.RungeKutta(1.0),
            autoreset_mode=mode,
        )
    )


def test_acting_and_learning_see_the_same_numbers(page: dict[str, Any]) -> None:
    """In the second of two rollouts as well, which begins in the middle of an episode."""
    torch.manual_seed(1)
    policy, env = page["policy"], environment(page, "SAME_STEP")
    stream = mt.MemoryStream(policy.memory.cell, 3)
    seen = torch.as_tensor(env.reset(seed=1)[0])
    at = seen, torch.ones(3, dtype=torch.bool), stream.initial_state()
    at, _ = page["rollout"](policy, env, at, 4)
    start = at[2]
    _, (shown, _, new, _) = page["rollout"](policy, env, at, 8)
    assert not new[0].any() and bool(new[3].all()) and int(new.sum()) == 3
    scores, _ = policy(shown, stream.unpacked(start), reset=new)
    anew, _ = policy(shown, reset=new)
    assert float((anew - scores)[:3].abs().max()) > 1e-3
    state = start
    with torch.no_grad():
        for step in range(len(shown)):
            remembered, state = stream(shown[step], stream.begun(state, new[step]))
            acted = policy.scores(remembered)
            torch.testing.assert_close(acted, scores[step], rtol=0, atol=1e-5)


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_which_observation_is_an_episodes_first(page: dict[str, Any], mode: str) -> None:
    env = environment(page, mode)
    env.reset(seed=0)
    before, firsts = np.zeros(3, dtype=bool), 0
    for _ in range(20):
        _, reward, over, cut, infos = env.step(np.zeros(3, dtype=int))
        now = over | cut
        new = now if mode == "SAME_STEP" else before
        assert np.array_equal(infos["t"] == 0.0, new)
        if mode == "NEXT_STEP":  # nobody acted on the row between
            assert not reward[before].any()
        firsts, before = firsts + int(new.sum()), now
    assert firsts == 6
