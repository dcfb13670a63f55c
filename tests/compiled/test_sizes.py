"""Sizes without a cliff: what is large runs, or is refused by name."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

import mann_torch as mt
from mann_torch.compiled.march import engine
from tests.conftest import generator, make_loop, make_scenario

CODE = """
import sys, torch, mann_torch as mt
kind, slots, neurons, batch, gradient, threads = sys.argv[1], *map(int, sys.argv[2:])
torch.set_num_threads(threads)
kinds = {"hard": mt.HardAttention, "soft": mt.SoftAttention,
         "always": lambda: mt.ReallocatingAttention("always")}
memory = mt.WorkingMemory(slots, neurons, kinds[kind]()) if slots else None
loop = mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, neurons, memory))
task = mt.Scenario(mt.Sinusoid([1.0, 0.3]), mt.arm_parameters(), 0.012)
free = loop.controller.tune("error_gain", "rate_W", "base_gain") if gradient else []
found = []
for engine in ("fused", "torch"):
    with torch.set_grad_enabled(bool(gradient)):
        run = mt.rollout(loop, task, batch_shape=(batch,), engine=engine,
                         generator=torch.Generator().manual_seed(0))
        slopes = torch.autograd.grad(mt.srmse(run).sum(), free) if gradient else []
    found.append([run.q, run.qd, *slopes])
worst = max(float(((a - b).abs().max() / b.abs().max()).detach()) for a, b in zip(*found))
print("worst", worst)
"""


@pytest.mark.parametrize(
    "arguments",
    [
        "hard 5 300 20 1 2",
        "always 4000 10 1 0 1",
        pytest.param("soft 4000 10 20 1 2", marks=pytest.mark.slow),
        pytest.param("hard 4000 10 20 0 2", marks=pytest.mark.slow),
        pytest.param("hard 0 6000 1 1 1", marks=pytest.mark.slow),
        pytest.param("hard 5 6000 20 1 2", marks=pytest.mark.slow),
    ],
)
def test_large_loops_agree_with_torch(arguments: str) -> None:
    """In a process of their own: a stack that overflows ends it without a word."""
    done = subprocess.run(
        [sys.executable, "-c", CODE, *arguments.split()], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert float(done.stdout.split()[-1]) <= 1e-12


def test_beyond_its_memory_the_engine_refuses_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "ROOM", 2**6)
    with pytest.raises(mt.KernelError, match=r"needs .* GiB of working memory .* limit is"):
        mt.rollout(make_loop("soft"), make_scenario(0.02), engine="fused", batch_shape=(9,))
    run = mt.rollout(make_loop("soft"), make_scenario(0.02), generator=generator())
    assert run.engine == "eager" and "working memory" in run.engine_reason


def test_a_smaller_stack_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays in the engine's memory instead of on the stack."""
    from mann_torch.compiled.march import kernel_text
    from mann_torch.simulation import compiled_engine

    found = []
    for stack in (kernel_text.STACK, 0):
        monkeypatch.setattr(kernel_text, "STACK", stack)
        compiled_engine._PROGRAMS.clear()
        loop = make_loop("reallocating_always")
        (gain,) = loop.controller.tune("write_gain")
        run = mt.rollout(
            loop, make_scenario(0.1), generator=generator(), batch_shape=(9,), engine="fused"
        )
        found.append([run.q.detach(), *torch.autograd.grad(run.q.square().sum(), gain)])
    compiled_engine._PROGRAMS.clear()
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True))
