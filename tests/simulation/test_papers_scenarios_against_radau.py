"""Scorecard N3: every scenario of the paper against SciPy's Radau on equations of its own.

Smooth controllers: the plain network, and soft attention from the paper's start and from slots
that start apart. All scenarios of a controller are one rollout; Radau solves each alone, anew
from each mass jump. The method has order two, so that 0.1 ms do for 1e-6.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.trees import leaf_names, leaves, map_tensors
from tests.simulation.by_hand import equations_of, radau
from tests.simulation.papers import APART, SCENARIOS, Side, side

SMOOTH = ("nn", "soft", "soft_state_keys", "soft" + APART, "soft_state_keys" + APART)


@functools.lru_cache(maxsize=1)
def rolled_out(
    name: str, scenarios: tuple[str, ...], horizon: float, dt: float, engine: str
) -> tuple[Side, mt.Trajectory]:
    """A controller in all those scenarios at once."""
    made = side(name, scenarios, horizon)
    step = mt.Implicit(dt)
    return made, made.run(solver=step, engine=engine, sample_dt=horizon / 10, motion_dt=horizon)


def check(made: Side, run: mt.Trajectory, number: int) -> None:
    """No state of this scenario is off by more than 1e-6 at any time at which it was kept."""
    states, memory = map_tensors(lambda x: x[:, number], run.states), made.loop.controller.memory
    used = None if memory is None else memory.initial_active
    scenario = made.each[number]
    equations, rows = equations_of(made.loop, scenario, states, used)
    masses, times = scenario.schedule["masses"], run.sample_t.tolist()
    found = radau(equations, masses, rows[0], times, rtol=1e-10, atol=1e-12)
    worst = max(float(np.abs(a - b).max()) for a, b in zip(found, rows, strict=True))
    assert len(times) == 11 and worst <= 1e-6, worst


@pytest.mark.slow
def test_the_first_seconds_of_a_scenario_are_radaus() -> None:
    made, run = rolled_out("soft" + APART, ("5",), 6.0, 1e-4, "compiled")
    assert made.scenario.knots()[0] == 5.0
    check(made, run, 0)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(SCENARIOS)), ids=SCENARIOS)
@pytest.mark.parametrize("name", SMOOTH)
def test_fifty_seconds_of_every_scenario_are_radaus(name: str, number: int) -> None:
    check(*rolled_out(name, SCENARIOS, 50.0, 1e-4, "compiled"), number)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nn", "soft_state_keys" + APART])
def test_the_torch_engine_is_radaus_through_a_mass_jump(name: str) -> None:
    """All scenarios in one batch; six seconds are 48,000 steps, of 0.7 to 1 ms each."""
    made, run = rolled_out(name, SCENARIOS, 6.0, 1.25e-4, "torch")
    assert run.engine == "eager"
    for number in range(len(SCENARIOS)):
        check(made, run, number)


def test_from_the_papers_start_soft_attention_has_no_use_for_keys() -> None:
    """All slots hold the same and stay together: the weights are 1/S under either key rule."""
    runs = [rolled_out(name, ("1",), 10.0, 4e-3, "compiled")[1] for name in SMOOTH[1:3]]
    a, b = (run.states.controller.memory for run in runs)
    torch.testing.assert_close(b.mu, a.mu, rtol=0, atol=1e-12)
    torch.testing.assert_close(a.mu, a.mu[:, :, :1].expand_as(a.mu), rtol=0, atol=1e-12)
    names = leaf_names(runs[0].states)
    for name, one, two in zip(names, *(leaves(run.states) for run in runs), strict=True):
        if name != "keys":
            torch.testing.assert_close(two, one, rtol=0, atol=1e-12, msg=name)
