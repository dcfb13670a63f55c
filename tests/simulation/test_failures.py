"""Scorecard F1: what goes wrong in a rollout is named, with time and state, at most a step late."""

from __future__ import annotations

import itertools

import pytest
import torch

import mann_torch as mt
from mann_torch.plants import NLinkArm
from tests.conftest import make_controller, make_loop, make_scenario
from tests.simulation.broken import LIMIT, InfLoad, NaNLoad, SingularArm, SingularLinks, moved
from tests.simulation.papers import side

BROKEN = (NaNLoad, InfLoad, SingularArm, SingularLinks)
#: torchdiffeq's methods, told to give up soon: an adaptive one's step underflows, or it needs too
#: many evaluations; a fixed one's state grows out of range.
ODEINT = {
    "dopri5": mt.Odeint("dopri5", max_evaluations=1000),
    "few": mt.Odeint("dopri5", max_evaluations=60),
    "scipy_solver": mt.Odeint("scipy_solver", max_evaluations=400),
    "rk4": mt.Odeint("rk4", max_step=2e-4),
}


def run_of(plant: mt.Plant, name: str = "nn", **options: object) -> mt.Trajectory:
    """A rollout without gradients; of three links under the plain network."""
    if plant.n_joints == 2:
        loop, scenario = mt.ClosedLoop(plant, make_controller(name)), make_scenario(0.15)
    else:
        loop = mt.ClosedLoop(plant, mt.MannController(3, 4))
        scenario = mt.Scenario(mt.Sinusoid([1.0, 0.0, 0.0]), plant.parameters_of(), 0.15)
    with torch.no_grad():
        return mt.rollout(loop, scenario, **options)


def check(run: mt.Trajectory, healthy: mt.Trajectory) -> None:
    """Stopped in the step that leads beyond the limit, or the next, and says so."""
    first = int(moved(healthy.q).squeeze(-1).to(torch.int64).argmax())
    assert 1 < first < len(healthy.t) - 2 and bool(torch.isfinite(healthy.q).all())
    stopped = float(run.stopped_at)
    assert stopped in healthy.t[first - 1 : first + 1].tolist()
    (phrase,) = run.describe_status()
    start, _, what = phrase.partition(": ")
    assert start == f"diverged at t = {stopped:.6g} s"
    assert what in ("q not finite", "q too large")
    assert bool(torch.isfinite(run.q).all()) and float(run.q[-1, 0].abs()) <= 1.5 * LIMIT


def slow_if_compiled(plant: type, engine: str, name: str, gradient: str) -> object:
    """Each compiles a kernel of its own."""
    slow = [pytest.mark.slow] if engine == "compiled" else []
    return pytest.param(plant, engine, name, gradient, marks=slow)


CASES = [
    slow_if_compiled(plant, engine, *kind)
    for plant, engine, kind in itertools.product(
        BROKEN, ("torch", "compiled"), [("nn", "plain"), ("hard", "plain"), ("hard", "hybrid")]
    )
    if plant is not SingularLinks or kind[0] == "nn"
]


@pytest.mark.parametrize(("plant", "engine", "name", "gradient"), CASES)
def test_a_right_hand_side_that_breaks_stops_its_sample(
    plant: type[mt.Plant], engine: str, name: str, gradient: str
) -> None:
    parts = (SingularLinks(3), NLinkArm(3)) if plant is SingularLinks else (plant(), None)
    options = {"engine": engine, "gradient": gradient}
    healthy = run_of(parts[1] or mt.TwoLinkArm(), name, engine="torch", gradient=gradient)
    run = run_of(parts[0], name, **options)
    assert run.engine == {"torch": "eager"}.get(engine, engine)
    assert run.status.tolist() == int(mt.Status.NOT_FINITE)
    check(run, healthy)


@pytest.mark.parametrize("plant", [NaNLoad, SingularArm])
@pytest.mark.parametrize("method", ODEINT)
def test_a_solver_that_cannot_go_on_stops_its_sample(plant: type[mt.Plant], method: str) -> None:
    run = run_of(plant(), solver=ODEINT[method])
    check(run, run_of(mt.TwoLinkArm(), solver=mt.Implicit(5e-3), engine="torch"))


@pytest.mark.parametrize("bad", [torch.inf, torch.nan])
@pytest.mark.parametrize("name", make_controller("reallocating_always_state_keys").constants())
def test_a_constant_spoilt_behind_our_back_is_named(name: str, bad: float) -> None:
    loop = make_loop("reallocating_always_state_keys")
    with torch.no_grad():  # as an optimizer's step may
        loop.controller.constant(name).fill_(bad)
        with pytest.raises(mt.DomainError, match=name):
            mt.rollout(loop, make_scenario(0.1))


def test_parameters_that_nobody_checked_are_named() -> None:
    loop, made = make_loop("nn"), make_scenario(0.1)
    for bad in (torch.inf, torch.nan, 0.0):
        spoilt = made.parameters._replace(masses=torch.tensor([1.0, bad], dtype=torch.float64))
        with pytest.raises(mt.DomainError, match="masses"):
            mt.rollout(loop, mt.Scenario(made.reference, spoilt, 0.1))
    loop.controller.network.initial_V.fill_(torch.inf)
    with pytest.raises(mt.ConfigError, match="initial V"):
        mt.rollout(loop, made)


@pytest.mark.parametrize("tiny", [1e-12, 1e-300])
def test_steps_too_small_for_any_machine_are_refused(tiny: float) -> None:
    with pytest.raises(mt.ConfigError, match="max_step"):
        mt.Odeint("rk4", max_step=tiny)
    with pytest.raises(mt.ConfigError, match="dt = "):
        run_of(mt.TwoLinkArm(), solver=mt.Implicit(tiny))


def test_chattering_slots_are_counted_or_stop_a_solver_that_would_follow_them() -> None:
    """Scenario 6 under hard attention: slots that start equal chatter from 0.04 s on."""
    made = side("hard", ("6",), 0.06)
    plain = made.run(engine="torch", sample_dt=1e-3, solver=mt.Implicit(1e-3))
    assert plain.describe_status() == ["ok"] and int(plain.final_mode.switches) > 2
    hybrid = made.run(engine="torch", gradient="hybrid")
    assert hybrid.describe_status() == ["ok"] and int(hybrid.events.sliding) > 0
    noted = int((plain.modes.switches[:, 0] > 0).to(torch.int64).argmax())
    first = float(plain.sample_t[noted - 1])  # the end of the step in which it began
    strict = mt.Odeint("dopri5", rtol=1e-9, atol=1e-12, max_evaluations=500)
    stopped = made.run(solver=strict)
    assert stopped.describe_status()[0].endswith("q not finite")
    assert 0.0 <= first - float(stopped.stopped_at) <= strict.dt + 1e-9
