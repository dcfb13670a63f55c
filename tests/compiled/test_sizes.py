"""Large networks and memories run, or are refused by name; nothing ends the process."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.compiled.march import engine, kernel_text, packing
from mann_torch.simulation.engines import compiled_engine
from tests.conftest import generator, make_loop, make_scenario
from tests.simulation.loops import case

CODE = """
import sys, time, torch
import mann_torch as mt
from mann_torch.trees import leaves
from mann_torch.types import MemoryState, NetworkState, PlantState
from tests.conftest import ATTENTION_MAKERS, randn

def relative(a, b):
    return float((a - b).abs().max() / b.abs().max().clamp(min=1e-300)) if a.numel() else 0.0

def network(controller, n_hidden, batch):
    first = controller.initial_weights((batch,), torch.Generator().manual_seed(1))
    return NetworkState(*(x + 0.3 * randn(*x.shape, seed=4) / n_hidden**0.5 for x in first))

def loop(attention, n_slots, n_hidden):
    if attention == "nn":
        return mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, n_hidden))
    memory = mt.WorkingMemory(n_slots, n_hidden, ATTENTION_MAKERS[attention]())
    mu = 0.3 + 0.2 * randn(*memory.initial_mu.shape, seed=2)
    keys = randn(*memory.initial_keys.shape, seed=3)
    memory.store_(MemoryState(mu, keys), torch.arange(n_slots) < max(n_slots // 2, 1))
    return mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, n_hidden, memory))

def check(attention, n_slots, n_hidden, batch, threads, steps, backward):
    made = loop(attention, n_slots, n_hidden)
    scenario = mt.Scenario(
        mt.Sinusoid([1.0, 0.3], [0.5, 0.7]), mt.arm_parameters(), steps * mt.Implicit().dt,
        start=PlantState(randn(batch, 2, seed=5), randn(batch, 2, seed=6)),
    )
    torch.set_num_threads(threads)
    first, found = network(made.controller, n_hidden, batch), []
    (gain,) = made.controller.tune("base_gain")
    for engine in ("compiled", "torch"):
        free = NetworkState(*(x.clone().requires_grad_(backward) for x in first))
        begun = time.monotonic()
        with torch.set_grad_enabled(backward):
            run = mt.rollout(made, scenario, weights=free, engine=engine)
        values = [run.qd, *leaves(run.states)]
        if backward:
            loss = run.qd.square().sum() + mt.srmse(run).sum()
            values += torch.autograd.grad(loss, [gain, *free])
        found.append([x.detach() for x in values])
        print(engine, round(time.monotonic() - begun, 2), "s", file=sys.stderr)
    worst = max(map(relative, *found))
    print(attention, n_slots, n_hidden, batch, threads, steps, backward, worst)
    assert worst < 1e-12
"""


SOLVE = """
from mann_torch.compiled import Layout, Leaf, Program
from mann_torch.compiled.march.agreement import check_agreement

def step(given):
    return [torch.linalg.solve(given.constants[0], given.carry[0])]

n = 400
layout = Layout(0, (Leaf((n, n)),), (), (), (Leaf((n, n)),), 0, ())
start = torch.Generator().manual_seed(0)
A, B = (torch.randn(n, n, generator=start, dtype=torch.float64) for _ in range(2))
check_agreement(Program(step, layout, [A + 20 * torch.eye(n), B]), 8, ((0,), ()))
"""


def run_all(*cases: tuple[object, ...], more: str = "") -> None:
    """In a process of its own: a stack that runs over must fail a test and not end them all."""
    code = "\n".join([CODE, *(f"check{one!r}" for one in cases), more])
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    print(done.stdout, done.stderr)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])


@pytest.mark.slow
def test_slots_neurons_and_linear_systems_by_thousands() -> None:
    run_all(
        ("hard", 4000, 10, 5, 2, 3, False),  # attention, slots, neurons, batch, threads, steps
        ("nn", 0, 6000, 1, 1, 3, False),
        ("hard", 4, 300, 20, 2, 3, False),
        more=SOLVE,
    )


@pytest.mark.slow
@pytest.mark.parametrize("attention", ["soft", "reallocating_initial", "reallocating_always"])
def test_four_thousand_slots(attention: str) -> None:
    run_all(
        *((attention, 4000, 10, batch, 2, 3, False) for batch in (1, 20)),
        *((attention, 4000, 10, batch, 2, 3, True) for batch in (1, 20)),
    )


@pytest.mark.slow
@pytest.mark.parametrize("attention", ["nn", "hard", "reallocating_always"])
def test_six_thousand_neurons(attention: str) -> None:
    run_all(
        (attention, 5, 6000, 1, 1, 3, True),
        (attention, 5, 6000, 20, 2, 3, False),
        (attention, 5, 6000, 20, 2, 3, True),
        (attention, 5, 300, 20, 2, 40, True),
    )


@pytest.mark.slow
@pytest.mark.parametrize("attention", ["relaxed_hard", "relaxed_always"])
def test_relaxed_attention_of_four_thousand_slots(attention: str) -> None:
    run_all((attention, 4000, 10, 1, 1, 1, False), (attention, 4000, 10, 5, 2, 1, True))


def refused(run: mt.Trajectory, *words: str) -> None:
    assert run.engine == "eager"
    assert all(word in run.engine_reason for word in words), run.engine_reason


def test_beyond_its_memory_the_engine_refuses_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "LIMIT", 500)
    loop, scenario = make_loop("nn"), make_scenario(0.02)
    with pytest.raises(mt.KernelError, match=r"needs .* GiB of working memory .* limit is"):
        mt.rollout(loop, scenario, engine="compiled")
    refused(mt.rollout(loop, scenario), "working memory", "fewer slots or neurons")
    monkeypatch.setattr(engine, "LIMIT", 10_000)  # enough for the forward march alone
    assert mt.rollout(loop, scenario).engine == "compiled"
    loop.controller.tune("base_gain")
    refused(mt.rollout(loop, scenario), "working memory")


def test_memory_that_cannot_be_had_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    lent = engine.Marcher._lent

    def none(self: engine.Marcher, *shape: int, whole: bool = False) -> Tensor:
        if len(shape) == 1:
            raise RuntimeError("DefaultCPUAllocator: can't allocate memory")
        return lent(self, *shape, whole=whole)

    monkeypatch.setattr(engine.Marcher, "_lent", none)
    refused(mt.rollout(make_loop("nn"), make_scenario(0.02)), "working memory cannot be had")


def test_less_memory_means_fewer_cores_or_lanes_and_the_same_bits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, whole = case("nn", 0.1, batch=20), engine.run_all
    used: list[int] = []
    torch.set_num_threads(2)

    def counted(launches: Sequence[Any], first: int, last: int) -> None:
        used.append(len(launches))
        whole(launches, first, last)

    monkeypatch.setattr(engine, "run_all", counted)
    runs, cores = [], []
    for limit, room in ((engine.LIMIT, packing.ROOM), (8_000, packing.ROOM), (8_000, 1_000)):
        monkeypatch.setattr(engine, "LIMIT", limit)
        monkeypatch.setattr(packing, "ROOM", room)
        with torch.no_grad():
            runs.append(made.run(engine="compiled"))
        cores.append(used[-1])
    assert cores == [2, 1, 2]
    assert torch.equal(runs[0].q, runs[1].q) and torch.equal(runs[0].q, runs[2].q)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nn", "reallocating_always"])
def test_a_smaller_stack_gives_the_same_bits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays in the engine's memory instead of on the stack."""
    found = []
    for stack in (kernel_text.STACK, 0):
        monkeypatch.setattr(kernel_text, "STACK", stack)
        compiled_engine._PROGRAMS.clear()
        loop = make_loop(name)
        (gain,) = loop.controller.tune("base_gain")
        run = mt.rollout(
            loop, make_scenario(0.1), generator=generator(), batch_shape=(9,), engine="compiled"
        )
        found.append([run.q.detach(), *torch.autograd.grad(run.q.square().sum(), gain)])
    compiled_engine._PROGRAMS.clear()
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True))
