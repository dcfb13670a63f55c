"""Hybrid steps of the compiled engine: the torch engine's states, counts and gradients."""

from __future__ import annotations

import dataclasses

import pytest
import torch

import mann_torch as mt
from tests.conftest import make_loop, make_scenario
from tests.simulation.loops import Case, case, freed
from tests.simulation.test_compiled_gradients import gradients
from tests.simulation.test_compiled_parity import assert_same, configured
from tests.simulation.test_hybrid import SWITCHING, check_against_differences, loss_of, sequence

#: The others: `make check`.
QUICK = ("reallocating_always_state_keys", "hard")
names = pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in SWITCHING]
)


def both(made: Case, *arguments: object, **options: object) -> list[mt.Trajectory]:
    with torch.no_grad():
        runs = [
            made.run(solver=mt.Implicit(), engine=engine, gradient="hybrid", **options)
            for engine in ("torch", "compiled")
        ]
    for mine, other in zip(*(sequence(run) for run in runs), strict=True):
        assert torch.equal(mine, other)
    return runs


@names
def test_one_step_from_anywhere(name: str) -> None:
    for reset in ("scaled", "raw") if name == QUICK[0] else ("scaled",):
        runs = both(case(name, mt.Implicit().dt, batch=40, reset=reset))
        assert_same(runs, 1e-12)


@names
def test_half_a_second_with_events(name: str) -> None:
    runs = both(case(name, 0.5, batch=8), sample_dt=0.02)
    assert_same(runs, 1e-12)
    assert runs[0].events is not None and int(runs[0].events.located.sum()) > 4


@names
def test_gradients_equal_those_of_torch(name: str) -> None:
    made, free = freed(case(name, 0.4, batch=6))
    constants = made.loop.controller.constants()
    if "shift_threshold" in constants:
        free["theta"] = constants["shift_threshold"].requires_grad_(True)
    expected, found = (
        gradients(made, free, engine=engine, gradient="hybrid") for engine in ("torch", "compiled")
    )
    assert found.keys() == expected.keys() == free.keys()
    for key, gradient in expected.items():
        assert gradient.norm() > 0, key
        assert float((found[key] - gradient).norm() / gradient.norm()) <= 1e-10, key


@pytest.mark.slow
@pytest.mark.parametrize("name", SWITCHING)
def test_twenty_seconds_and_their_gradients(name: str) -> None:
    found = []
    for engine in ("torch", "compiled"):
        made, free = freed(case(name, 20.0, batch=2))
        constants = made.loop.controller.constants()
        if "shift_threshold" in constants:
            free["theta"] = constants["shift_threshold"].requires_grad_(True)
        run = made.run(engine=engine, gradient="hybrid", sample_dt=0.1)
        wanted = list(free.values())
        slopes = [torch.autograd.grad(x, wanted, retain_graph=True) for x in loss_of(run)]
        found.append((run, slopes))
    (expected, theirs), (mine, own) = found
    assert all(torch.equal(a, b) for a, b in zip(sequence(expected), sequence(mine), strict=True))
    assert mine.events is not None and int(mine.events.located.sum()) > 0
    print("located, sliding, unresolved:", *(count.tolist() for count in mine.events))
    assert float((mine.q - expected.q).abs().max()) <= 1e-9
    for sample in range(2):
        worst = max(
            float((a - b).norm() / b.norm())
            for a, b in zip(own[sample], theirs[sample], strict=True)
            if b.norm() > 0
        )
        print(f"sample {sample}: gradients {worst:.1e} apart")
        assert worst <= 1e-9


@pytest.mark.slow
def test_a_samples_bits_depend_neither_on_its_mates_nor_on_threads() -> None:
    made, free = freed(case(QUICK[0], 0.3, batch=9))
    found = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        run = made.run(engine="compiled", gradient="hybrid")
        found.append((run.q, torch.autograd.grad(loss_of(run).sum(), free["W"])[0]))
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True))
    start = made.scenario.start
    assert start is not None
    for i in (0, 8):
        alone = dataclasses.replace(
            made.scenario, start=type(start)(*(leaf[i : i + 1] for leaf in start))
        )
        network = type(made.weights)(*(leaf[i : i + 1] for leaf in made.weights))
        run = Case(made.loop, alone, network).run(engine="compiled", gradient="hybrid")
        (own,) = torch.autograd.grad(loss_of(run).sum(), network.W)
        assert torch.equal(run.q[:, 0], found[0][0][:, i])
        assert torch.equal(own[0], found[0][1][i])


@pytest.mark.parametrize(
    ("name", "constant"),
    [
        (QUICK[0], "shift_threshold"),
        pytest.param(QUICK[0], "write_gain", marks=pytest.mark.slow),
        pytest.param("hard", "write_gain", marks=pytest.mark.slow),
    ],
)
def test_equal_to_central_differences(name: str, constant: str) -> None:
    check_against_differences(name, constant, "compiled", 0.5)


def test_segments_give_the_same_bits() -> None:
    made, free = freed(case(QUICK[0], 0.4))
    whole = gradients(made, free, engine="compiled", gradient="hybrid")
    for steps in (2, 7, 50):
        memory = 2.0 * 8 * 3 * 200 * steps
        pieces = gradients(made, free, engine="compiled", gradient="hybrid", tape_memory=memory)
        assert all(torch.equal(pieces[key], whole[key]) for key in whole)


@pytest.mark.slow
def test_chattering_is_averaged_and_counted_over_a_minute() -> None:
    """Hard attention, scenario 1: the paper's controller, in which event times need not exist."""
    made = configured("controller=hard", horizon=60.0, draws=4)

    runs = {}
    (gain,) = made.loop.controller.tune("write_gain")
    for gradient in ("plain", "hybrid"):
        runs[gradient] = mt.rollout(
            made.loop,
            made.scenario,
            weights=made.weights,
            engine="compiled",
            gradient=gradient,
            motion_dt=0.05,
            sample_until=0.0,
        )
    plain, hybrid = (mt.srmse(runs[gradient]) for gradient in ("plain", "hybrid"))
    events = runs["hybrid"].events
    assert events is not None and int(events.sliding.sum()) > 0
    print("located, sliding, unresolved:", *(count.tolist() for count in events))
    (slope,) = torch.autograd.grad(hybrid.sum(), gain)
    assert bool(torch.isfinite(slope).all())
    assert float((hybrid / plain - 1).abs().max()) <= 0.01


def test_without_switches_hybrid_is_plain() -> None:
    loop, scenario = make_loop("nn"), make_scenario(0.1)
    plain, hybrid = (
        mt.rollout(loop, scenario, engine="compiled", gradient=gradient)
        for gradient in ("plain", "hybrid")
    )
    assert hybrid.events is None and torch.equal(plain.q, hybrid.q)


def test_a_diverging_sample_stops_alone_on_both_engines() -> None:
    made = case(QUICK[0], 0.1, batch=3)
    W = made.weights.W.clone()
    W[1] = 1e9
    runs = both(made._replace(weights=made.weights._replace(W=W)))
    assert runs[0].describe_status() == runs[1].describe_status()
    assert_same(runs, 1e-9)
