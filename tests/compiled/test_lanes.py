"""A sample's bits depend neither on lanes, nor on its mates, nor on threads, nor on memory."""

from __future__ import annotations

import dataclasses
import signal
import subprocess
import sys
import time

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.compiled.march import engine
from mann_torch.trees import leaves, map_tensors
from mann_torch.types import NetworkState
from tests.simulation.loops import Case, case

NAME = "reallocating_always_state_keys"


def free_start(made: Case) -> tuple[Case, list[Tensor]]:
    """The case with its start and initial weights free, one row a sample."""
    start = map_tensors(lambda x: x.detach().clone().requires_grad_(), made.scenario.start)
    network = map_tensors(lambda x: x.detach().clone().requires_grad_(), made.network)
    scenario = dataclasses.replace(made.scenario, start=start)
    return made._replace(scenario=scenario, network=network), [*start, *network]


def bits(made: Case, **options: object) -> list[Tensor]:
    """Motion, states, and the gradient of every sample's own numbers: samples second."""
    free, tensors = free_start(made)
    run = free.run(sample_dt=0.1, engine="fused", **options)
    slopes = torch.autograd.grad(run.q.square().sum() + mt.srmse(run).sum(), tensors)
    found = [run.q, run.qd, run.squared_error, *leaves(run.states), *(g[None] for g in slopes)]
    return [x.detach() for x in found]


def rows(made: Case, chosen: list[int]) -> Case:
    start = map_tensors(lambda x: x[chosen], made.scenario.start)
    scenario = dataclasses.replace(made.scenario, start=start)
    network = NetworkState(*(x[chosen] for x in made.network))
    return made._replace(scenario=scenario, network=network)


def assert_equal(mine: list[Tensor], other: list[Tensor]) -> None:
    for a, b in zip(mine, other, strict=True):
        assert torch.equal(a, b)


def test_a_sample_alone_has_the_bits_it_has_in_a_batch() -> None:
    made = case(NAME, 0.2, batch=11)
    together = bits(made)
    for number in (0, 3, 10):
        alone = bits(rows(made, [number]))
        assert_equal(alone, [x[:, [number]] for x in together])


@pytest.mark.parametrize("lanes", [1, 4, pytest.param(2, marks=pytest.mark.slow)])
def test_every_number_of_lanes_gives_the_same_bits(
    lanes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = case(NAME, 0.2, batch=11)
    usual = bits(made)
    monkeypatch.setattr(engine, "lanes_for", lambda *_: lanes)
    assert_equal(bits(made), usual)


def test_one_thread_and_two_give_the_same_bits() -> None:
    made, before, found = case(NAME, 0.2, batch=19), torch.get_num_threads(), []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            found.append(bits(made))
    finally:
        torch.set_num_threads(before)
    assert_equal(*found)


@pytest.mark.parametrize("steps", [1, 31, 32, 33, 65, 300])
def test_checkpoints_far_apart_give_the_same_bits(steps: int) -> None:
    """Each step's dt is 4 ms; with little memory checkpoints are 64, 128 or more steps apart."""
    made = case("soft", 4e-3 * steps, batch=9)
    usual = bits(made)
    for memory in (1.0, 2e5, 1e6):
        assert_equal(bits(made, tape_memory=memory), usual)


def test_a_sample_that_diverges_in_lane_3_of_8_leaves_its_mates_their_bits() -> None:
    made = case(NAME, 0.1, batch=8)
    W = made.network.W.clone()
    W[3] = 1e9
    broken = made._replace(network=made.network._replace(W=W))
    mates = [0, 1, 2, 4, 5, 6, 7]
    run = broken.run(engine="fused")
    assert (run.status != 0).tolist() == [i == 3 for i in range(8)]
    reference = broken.run(engine="torch")
    assert run.describe_status() == reference.describe_status()
    assert torch.isfinite(run.q).all()
    sound = made.run(engine="fused")
    assert torch.equal(run.q[:, mates], sound.q[:, mates])
    (gain,) = broken.loop.controller.tune("base_gain")
    slopes = [
        torch.autograd.grad(b.run(engine="fused").q[:, mates].square().sum(), gain)[0]
        for b in (broken, made)
    ]
    assert torch.equal(*slopes) and bool(torch.isfinite(slopes[0]))


LONG = """
import os, sys, torch, mann_torch as mt
torch.set_num_threads(2)
loop = mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, 6))
def run(horizon, **more):
    task = mt.Scenario(mt.Sinusoid([1.0, 0.3]), mt.arm_parameters(), horizon)
    return mt.rollout(loop, task, batch_shape=(64,), generator=torch.Generator().manual_seed(0),
                      motion_dt=1.0, sample_until=0.0, engine="fused", **more)
(gain,) = loop.controller.tune("base_gain")
mt.srmse(run(0.1)).sum().backward()
long = mt.srmse(run(60.0)).sum() if sys.argv[1] == "back" else None
print("ready", flush=True)
try:
    if long is None:
        with torch.no_grad():
            run(20000.0)
    else:
        for _ in range(1000):
            long.backward(retain_graph=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize("way", ["forth", "back"])
def test_ctrl_c_is_heard(way: str) -> None:
    # A shell's background job ignores SIGINT, and so would its children.
    child = subprocess.Popen(
        [sys.executable, "-c", LONG, way],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert child.stdout is not None and child.stdout.readline() == "ready\n"
    time.sleep(0.5)
    began = time.monotonic()
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=60)
    assert "interrupted" in out and time.monotonic() - began < 20
