"""The hybrid gradient of whole rollouts: against differences of the hybrid rollout itself."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.simulation import EventCounts
from mann_torch.trees import leaves
from tests.conftest import generator, make_loop, make_scenario
from tests.simulation.loops import Case, case

BATCH = 8
SWITCHING = (
    "hard",
    "hard_state_keys",
    "reallocating_initial",
    "reallocating_initial_state_keys",
    "reallocating_always",
    "reallocating_always_state_keys",
)
CONSTANTS = ("write_gain", "shift_threshold")


def loss_of(run: mt.Trajectory) -> Tensor:
    """(B,) of everything a switch may touch."""
    memory = run.states.controller.memory
    assert memory is not None
    ends = 0.1 * run.q[-1].square().sum(-1) + 0.1 * memory.mu[-1].square().sum((-1, -2))
    return mt.srmse(run).sum(dim=-1) + ends


def with_constant(made: Case, name: str, value: Tensor, **options: object) -> mt.Trajectory:
    made.loop.controller.initialize(**{name: value})
    return made.run(sample_dt=0.1, **options)


def sequence(run: mt.Trajectory) -> list[Tensor]:
    assert run.events is not None
    return [*run.events, run.final_mode.switches, run.final_mode.reallocations]


def check_against_differences(name: str, constant: str, engine: str, horizon: float) -> None:
    """Isolated events only: hybrid is right to 1e-5 where plain is off by more than 1e-3."""
    made = case(name, horizon, batch=BATCH)
    controller = made.loop.controller
    centre = float(controller.constant(constant))
    value = torch.full((BATCH,), centre, dtype=torch.float64)
    slopes = []
    for gradient in ("hybrid", "plain"):
        controller.initialize(**{constant: value})
        (free,) = controller.tune(constant)
        loss = loss_of(made.run(sample_dt=0.1, gradient=gradient, engine=engine)).sum()
        loss = loss + 0.0 * free.sum()  # plain steps know theta from comparisons alone
        (slope,) = torch.autograd.grad(loss, free)
        slopes.append(slope)
    with torch.no_grad():
        step = 1e-6 * centre
        middle, above, below = (
            with_constant(made, constant, value + k * step, gradient="hybrid", engine=engine)
            for k in (0, 1, -1)
        )
        expected = (loss_of(above) - loss_of(below)) / (2 * step)
    for counts in zip(*(sequence(run) for run in (middle, above, below)), strict=True):
        assert torch.equal(counts[0], counts[1]) and torch.equal(counts[0], counts[2])
    assert middle.events is not None
    clean = (middle.events.sliding == 0) & (middle.events.unresolved == 0)
    clean = clean & (middle.events.located > 0)
    assert int(clean.sum()) >= 2
    errors = [((slope - expected) / expected).abs()[clean] for slope in slopes]
    assert float(errors[0].max()) <= 1e-5, errors
    assert float(errors[1].max()) > 1e-3, errors


@pytest.mark.parametrize(
    ("name", "constant"),
    [
        pytest.param("hard", "write_gain", marks=pytest.mark.slow),
        pytest.param("hard_state_keys", "write_gain", marks=pytest.mark.slow),
        ("reallocating_initial", "shift_threshold"),
        *(
            pytest.param("reallocating_always", constant, marks=pytest.mark.slow)
            for constant in CONSTANTS
        ),
        ("reallocating_always_state_keys", "shift_threshold"),
        pytest.param("reallocating_always_state_keys", "write_gain", marks=pytest.mark.slow),
    ],
)
def test_equal_to_central_differences(name: str, constant: str) -> None:
    check_against_differences(name, constant, "torch", 0.5)


def test_a_batch_is_its_samples() -> None:
    made = case("reallocating_always", 0.2, batch=3)
    start = made.scenario.start
    assert start is not None
    with torch.no_grad():
        together = made.run(engine="torch", gradient="hybrid")
        for i in range(3):
            alone = case("reallocating_always", 0.2, batch=3)
            row = type(start)(*(leaf[i] for leaf in start))
            object.__setattr__(alone.scenario, "start", row)
            network = type(made.weights)(*(leaf[i] for leaf in made.weights))
            run = alone._replace(weights=network).run(engine="torch", gradient="hybrid")
            torch.testing.assert_close(together.q[:, i], run.q, rtol=0, atol=1e-12)
            for mine, own in zip(sequence(together), sequence(run), strict=True):
                assert int(mine[i]) == int(own)


@pytest.mark.parametrize("name", ["nn", "soft"])
def test_without_switches_hybrid_is_plain(name: str) -> None:
    loop, scenario = make_loop(name), make_scenario(0.1)
    plain, hybrid = (
        mt.rollout(loop, scenario, generator=generator(), engine="torch", gradient=gradient)
        for gradient in ("plain", "hybrid")
    )
    assert hybrid.events is None and torch.equal(plain.q, hybrid.q)


def test_between_events_values_are_those_of_plain_steps() -> None:
    made = case("hard", 0.1, batch=8)
    with torch.no_grad():
        plain, hybrid = (made.run(engine="torch", gradient=g) for g in ("plain", "hybrid"))
    assert isinstance(hybrid.events, EventCounts) and plain.events is None
    quiet = (hybrid.events.located == 0) & (hybrid.events.sliding == 0)
    assert bool(quiet.any()) and not bool(quiet.all())
    for mine, other in zip(leaves(plain.states), leaves(hybrid.states), strict=True):
        torch.testing.assert_close(mine[:, quiet], other[:, quiet], rtol=1e-12, atol=1e-14)


def test_forward_mode_goes_through_events() -> None:
    made = case("reallocating_always_state_keys", 0.1, batch=2)

    def loss(amplitude: Tensor) -> Tensor:
        reference = mt.Sinusoid(amplitude, [0.5, 0.7], [0.1, -0.2])
        scenario = dataclasses.replace(made.scenario, reference=reference)
        return loss_of(made._replace(scenario=scenario).run(engine="torch", gradient="hybrid"))

    at = torch.tensor([1.0, 0.3], dtype=torch.float64, requires_grad=True)
    direction = torch.tensor([0.7, -0.4], dtype=torch.float64)
    (slope,) = torch.autograd.grad(loss(at).sum(), at)
    _, forwards = torch.func.jvp(loss, (at.detach(),), (direction,))
    torch.testing.assert_close(forwards.sum(), slope @ direction, rtol=1e-9, atol=0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"gradient": "exact"}, "gradient = 'exact': choose from plain, hybrid"),
        ({"gradient": "hybrid", "solver": mt.Odeint("dopri5")}, "implicit solver"),
    ],
)
def test_what_cannot_be_had_is_named(options: dict, words: str) -> None:
    with pytest.raises(mt.ConfigError, match=words):
        mt.rollout(make_loop("hard"), make_scenario(0.02), **options)


def test_a_diverging_sample_stops_alone() -> None:
    made = case("reallocating_always", 0.1, batch=3)
    W = made.weights.W.clone()
    W[1] = 1e9
    made = made._replace(weights=made.weights._replace(W=W))
    (gain,) = made.loop.controller.tune("write_gain")
    run = made.run(engine="torch", gradient="hybrid")
    assert run.status.tolist()[0] == run.status.tolist()[2] == 0 and run.status[1] != 0
    (slope,) = torch.autograd.grad(run.q[:, [0, 2]].square().sum(), gain)
    assert bool(torch.isfinite(slope).all()) and bool(torch.isfinite(run.q).all())
