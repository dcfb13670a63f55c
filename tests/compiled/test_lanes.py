"""A sample's bits depend neither on lanes, nor on its mates, nor on threads or checkpoints."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.compiled.march import job as march_job
from mann_torch.trees import leaves
from mann_torch.types import NetworkState, PlantState
from tests.conftest import randn
from tests.simulation.loops import NAMES, Case, case, freed

LANES = (1, 2, 4, 8)
#: Each is some seconds of compiling; all run with `make check`.
QUICK = ("nn", "reallocating_always_state_keys")
EVERY = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]


def rows(made: Case, chosen: Sequence[int]) -> Case:
    """The case of these samples alone."""
    start, index = made.scenario.start, list(chosen)
    assert start is not None
    return Case(
        made.loop,
        dataclasses.replace(made.scenario, start=PlantState(*(leaf[index] for leaf in start))),
        NetworkState(*(leaf[index] for leaf in made.weights)),
    )


def outputs(run: mt.Trajectory) -> list[Tensor]:
    """All that a trajectory keeps, batch first."""
    found = [run.q, run.qd, run.squared_error, *leaves(run.states), *leaves(run.modes)]
    return [x.transpose(0, 1) for x in found] + [run.status, *leaves(run.final_mode)]


def gradients(
    made: Case, chosen: Sequence[int], horizon: int, engine: str = "compiled", **options: object
) -> tuple[list[Tensor], list[Tensor], mt.Trajectory]:
    """Of a sample's own start and weights, and of what all share, for a loss without sums of torch.

    Weights of the loss belong to samples by number.
    """
    made, free = freed(rows(made, chosen))
    run = made.run(engine=engine, **options)
    assert run.engine == {"torch": "eager"}.get(engine, engine)
    loss = run.q.new_zeros(())
    for seed, x in enumerate((run.q, run.qd, run.squared_error, *leaves(run.states))):
        weights = randn(11, horizon, *x.shape[2:], seed=seed)[list(chosen), : len(x)]
        loss = loss + (x * weights.transpose(0, 1)).sum()
    assert loss.requires_grad
    own = [*(free[f"start {k}"] for k in ("q", "qd")), *made.weights]
    shared = [x for x in free.values() if all(x is not y for y in own)]
    found, again = (
        torch.autograd.grad(loss, [*own, *shared], retain_graph=True, materialize_grads=True)
        for _ in range(2)
    )
    assert_equal(found, again)
    return list(found[: len(own)]), list(found[len(own) :]), run


def assert_equal(mine: Sequence[Tensor], other: Sequence[Tensor]) -> None:
    for a, b in zip(mine, other, strict=True):
        assert torch.equal(a, b)


@pytest.mark.parametrize("name", EVERY)
def test_each_sample_alone_has_the_bits_it_has_among_others(name: str) -> None:
    made = case(name, 0.2, batch=11)
    with torch.no_grad():
        together = outputs(made.run(engine="compiled"))
        for i in range(11):
            alone = outputs(rows(made, [i]).run(engine="compiled"))
            assert_equal(alone, [x[i : i + 1] for x in together])


@pytest.mark.parametrize(
    "name", [n if n == "nn" else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]
)
def test_gradients_of_each_sample_alone(name: str) -> None:
    made = case(name, 0.2, batch=11)
    together, _, _ = gradients(made, range(11), 60)
    for i in (0, 3, 10):
        alone, _, _ = gradients(made, [i], 60)
        assert_equal(alone, [x[i : i + 1] for x in together])


@pytest.mark.parametrize(
    ("name", "lanes", "backward"),
    [
        ("nn", (1, 2, 4), False),
        *(pytest.param(n, LANES, True, marks=pytest.mark.slow) for n in NAMES),
    ],
)
def test_bits_are_the_same_in_any_number_of_lanes_and_threads(
    name: str, lanes: tuple[int, ...], backward: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = case(name, 0.2, batch=11)
    found = []
    for count in lanes:
        monkeypatch.setattr(march_job, "lanes_for", lambda *_, count=count: count)
        for threads in (1, 2):
            torch.set_num_threads(threads)
            if backward:
                own, shared, run = gradients(made, range(11), 60)
                found.append([*own, *shared, *outputs(run)])
            else:
                with torch.no_grad():
                    found.append(outputs(made.run(engine="compiled")))
    for other in found[1:]:
        assert_equal(found[0], other)


def diverging(name: str) -> Case:
    """Eight samples, of which number 3 feeds itself beyond every bound."""
    made = case(name, 0.1, batch=8)
    W = made.weights.W.clone()
    W[3] = 1e9
    return made._replace(weights=made.weights._replace(W=W))


@pytest.mark.parametrize("name", EVERY)
def test_a_sample_that_diverges_leaves_its_mates_undisturbed(name: str) -> None:
    made, others = diverging(name), [0, 1, 2, 4, 5, 6, 7]
    with torch.no_grad():
        run, reference = (made.run(engine=e) for e in ("compiled", "torch"))
        mates = outputs(rows(made, others).run(engine="compiled"))
    assert run.status.tolist().count(0) == 7 and run.status[3] != 0
    assert torch.equal(run.status, reference.status)
    assert torch.equal(run.stopped_at.nan_to_num(-1.0), reference.stopped_at.nan_to_num(-1.0))
    assert run.describe_status() == reference.describe_status()
    assert_equal([x[others] for x in outputs(run)], mates)


@pytest.mark.parametrize(
    "name", [n if n == "nn" else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]
)
def test_a_sample_that_diverges_spoils_no_gradient(name: str) -> None:
    made, others = diverging(name), [0, 1, 2, 4, 5, 6, 7]
    own, shared, _ = gradients(made, range(8), 60)
    mates, _, _ = gradients(made, others, 60)
    assert all(bool(x.isfinite().all()) for x in (*own, *shared))
    assert_equal([x[others] for x in own], mates)
    expected = gradients(made, range(8), 60, engine="torch")
    for mine, other in zip([*own, *shared], [*expected[0], *expected[1]], strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-9, atol=1e-9 * float(other.abs().max()))


@pytest.mark.parametrize("steps", [1, 31, 32, 33, 65, 300, 1000])
def test_checkpoints_far_apart_change_no_bit(steps: int) -> None:
    solver = mt.Implicit()
    made = case("nn", steps * solver.dt, batch=11)
    found = []
    for memory in (256e6, 1e5, 3e4, 1.0):
        own, shared, run = gradients(made, range(11), steps + 3, solver=solver, tape_memory=memory)
        found.append([*own, *shared])
    assert abs(len(run.step_t) - 1 - steps) <= 2  # mass jumps cut steps
    for other in found[1:]:
        assert_equal(found[0], other)


def test_progress_counts_every_step_once() -> None:
    made = case("nn", 40.0, batch=3)
    seen: list[int] = []
    with torch.no_grad():
        run = made.run(engine="compiled", progress=seen.append, motion_dt=1.0, sample_until=0.0)
    assert sum(seen) == len(run.step_t) - 1 and len(seen) > 2


INTERRUPTED = """
import os, signal, sys, threading, time, torch
import mann_torch as mt
from tests.simulation.loops import case, freed

backward, threads = sys.argv[1] == "backward", int(sys.argv[2])
torch.set_num_threads(threads)

def run(horizon):
    made, _ = freed(case("nn", horizon, batch=40))
    with torch.set_grad_enabled(backward):
        found = made.run(engine="compiled", motion_dt=horizon, sample_until=0.0)
    return found.squared_error.sum()

def go(horizon):
    loss = run(horizon)
    if backward:
        print("ready", flush=True)
        loss.backward()

go(0.1)
loss = run(3000.0) if backward else None  # seconds: longer than the wait before Ctrl-C
print("ready", flush=True)
try:
    loss.backward() if backward else run(20000.0)
    print("went through")
except KeyboardInterrupt:
    print("interrupted", flush=True)
go(0.1)
print("goes on")
"""


@pytest.mark.parametrize(
    ("side", "threads"),
    [
        pytest.param("forward", 2),
        pytest.param("forward", 1, marks=pytest.mark.slow),
        pytest.param("backward", 2, marks=pytest.mark.slow),
        pytest.param("backward", 1, marks=pytest.mark.slow),
    ],
)
def test_ctrl_c_is_heard_and_nothing_is_left_running(side: str, threads: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, side, str(threads)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        # A shell's background job ignores SIGINT, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stdout is not None
    lines = iter(process.stdout.readline, "")
    seen = [next(lines)]
    if side == "backward":
        seen.append(next(lines))
    time.sleep(0.7)
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert next(lines) == "interrupted\n"
    assert time.monotonic() - begun < 2.0
    assert list(lines)[-1] == "goes on\n" and process.wait() == 0
