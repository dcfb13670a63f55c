"""Scorecard N3: switching controllers against Radau with events, up to where slots chatter.

The compiled engine locates events inside its steps (`gradient="hybrid"`); `switching_by_hand`
locates them to rounding and solves anew from each. Under representation keys slots soon chatter:
those of hard attention start equal, and do so within 0.06 s in every scenario. Under state keys
they never do in 50 s.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.trees import map_tensors
from tests.simulation.by_hand import equations_of
from tests.simulation.papers import APART, SCENARIOS, Side, side
from tests.simulation.switching_by_hand import Event, Rule, Switching


class Stretch(NamedTuple):
    """How far to look, and how closely [s]."""

    horizon: float
    dt: float
    sample_dt: float  # modes are compared
    state_dt: float  # states are compared


SHORT, MIDDLE = Stretch(0.06, 1e-5, 1e-3, 5e-3), Stretch(10.0, 1e-4, 1e-2, 1e-1)
LONG = Stretch(50.0, 1e-4, 1e-2, 5.0)
CHATTERING = {"hard": SHORT, "reallocating_initial": MIDDLE}
ISOLATED = ("hard_state_keys", "reallocating_initial_state_keys", "reallocating_always_state_keys")


@functools.lru_cache(maxsize=1)
def rolled_out(name: str, of: Stretch) -> tuple[Side, mt.Trajectory]:
    """A controller in all scenarios at once, through events."""
    made = side(name, SCENARIOS, of.horizon)
    return made, made.run(
        solver=mt.Implicit(of.dt),
        gradient="hybrid",
        engine="compiled",
        sample_dt=of.sample_dt,
        motion_dt=of.horizon,
    )


def check(name: str, number: int, of: Stretch) -> float:
    """Equal states and slots up to the time that is returned: the horizon, or first chattering."""
    made, run = rolled_out(name, of)
    controller, scenario = made.loop.controller, made.each[number]
    states, modes = (map_tensors(lambda x: x[:, number], tree) for tree in (run.states, run.modes))
    equations, rows = equations_of(made.loop, scenario, states, modes.active[0])
    theta = controller.constants().get("shift_threshold")
    if theta is not None:
        theta = float(theta.detach().expand(len(SCENARIOS))[number])
    mine = Switching(equations, Rule(theta, "always" in name), rows[0])
    began = mine.slot
    times, masses = run.sample_t.tolist(), scenario.schedule["masses"]
    every = round(of.state_dt / of.sample_dt)
    compared = dict(zip(times[every::every], rows[every::every], strict=True))
    worst = 0.0
    for end in sorted({*compared, *(k for k in masses.knots() if k < of.horizon)}):
        (m,) = masses.at(torch.tensor([mine.t], dtype=torch.float64)).numpy()
        if not mine.flow(end, m):
            break
        if end in compared:
            worst = max(worst, float(np.abs(mine.y - compared[end]).max()))
    assert worst <= 1e-6, worst
    check_modes(mine.events, began, modes, times, before=mine.t, near=2 * of.dt)
    return mine.t


def check_modes(
    events: list[Event], began: int, modes: object, times: list[float], before: float, near: float
) -> None:
    """The same slot, as many switches and resets at every sample that is not just at an event."""
    slots = np.array([began, *(event.attended for event in events)])
    switches = np.cumsum(np.diff(slots, prepend=began) != 0)
    resets = np.cumsum([0, *(event.reset for event in events)])
    for k, t in enumerate(times[1:], start=1):
        if t >= before - near or any(abs(t - event.time) < near for event in events):
            continue
        past = sum(event.time < t for event in events)
        found = (modes.attended[k], modes.switches[k], modes.reallocations[k])
        assert (slots[past], switches[past], resets[past]) == tuple(int(x) for x in found), t


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(SCENARIOS)), ids=SCENARIOS)
@pytest.mark.parametrize("name", CHATTERING)
def test_up_to_the_first_chattering_slots_and_states_are_radaus(name: str, number: int) -> None:
    of = CHATTERING[name]
    assert check(name, number, of) < of.horizon


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(SCENARIOS)), ids=SCENARIOS)
@pytest.mark.parametrize("name", ISOLATED)
def test_fifty_seconds_of_isolated_events_are_radaus(name: str, number: int) -> None:
    assert check(name, number, LONG) == LONG.horizon


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["4_long_arm", "5", "6"])
def test_hard_attention_from_slots_that_start_apart_is_radaus(scenario: str) -> None:
    """A switch or two by representation keys before slots chatter, if they do in 10 s."""
    assert check("hard" + APART, SCENARIOS.index(scenario), MIDDLE) > 1.0
