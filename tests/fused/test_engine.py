"""Which engine is taken, and what is kept."""

from __future__ import annotations

import logging
import subprocess
import sys

import pytest
import torch

import mann_torch as mt
from mann_torch import fused
from mann_torch.fused import kernels
from mann_torch.simulation import fused_engine
from mann_torch.types import Comparison
from tests.conftest import generator, make_controller, make_loop, make_scenario
from tests.fused.loops import case
from tests.fused.test_parity import assert_same


class Lukewarm(mt.SoftAttention):
    """An attention of the user's own."""

    def forward(self, comparison: Comparison, active: torch.Tensor) -> torch.Tensor:
        return active.double() / active.sum(dim=-1, keepdim=True)


def own_loop() -> mt.ClosedLoop:
    memory = mt.WorkingMemory(3, 6, Lukewarm())
    return mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, 6, memory))


def test_auto_takes_the_fused_engine_and_says_so() -> None:
    run = mt.rollout(make_loop("hard"), make_scenario(0.02))
    assert run.engine == "fused" and run.engine_reason == "every part has a fused form"
    run = mt.rollout(make_loop("hard"), make_scenario(0.02), engine="torch")
    assert run.engine == "eager" and run.engine_reason == "asked for"


def test_a_part_of_ones_own_runs_on_the_torch_engine_and_is_named() -> None:
    run = mt.rollout(own_loop(), make_scenario(0.02))
    assert run.engine == "eager" and "Lukewarm" in run.engine_reason
    run = mt.rollout(make_loop("nn"), make_scenario(0.01), mt.Odeint("dopri5"))
    assert run.engine == "eager" and "dopri5" in run.engine_reason
    with pytest.raises(mt.ConfigError, match="Lukewarm has no fused form"):
        mt.rollout(own_loop(), make_scenario(0.02), engine="fused")


class Drifting(mt.ClosedLoop):
    """A loop of the user's own."""


def test_what_the_kernel_would_not_see_goes_to_the_torch_engine() -> None:
    loop = Drifting(mt.TwoLinkArm(), make_controller("nn"))
    assert "Drifting" in mt.rollout(loop, make_scenario(0.01)).engine_reason
    loop = make_loop("nn")
    loop.controller.register_forward_hook(lambda *_: None)
    assert "hooks" in mt.rollout(loop, make_scenario(0.01)).engine_reason
    empty = mt.rollout(make_loop("nn"), make_scenario(0.01), batch_shape=(0,))
    assert empty.engine_reason == "an empty batch" and empty.q.shape[1:] == (0, 2)


def test_functional_transforms_go_on_in_torch() -> None:
    loop = make_loop("nn")

    def loss(masses: torch.Tensor) -> torch.Tensor:
        scenario = mt.Scenario(
            mt.Sinusoid([1.0, 0.3]), mt.ArmParameters(masses, *mt.arm_parameters()[1:]), 0.02
        )
        run = mt.rollout(loop, scenario)
        return run.qd.square().sum()

    masses = torch.tensor([0.8, 2.3], dtype=torch.float64, requires_grad=True)
    (expected,) = torch.autograd.grad(loss(masses), masses)
    torch.testing.assert_close(torch.func.grad(loss)(masses.detach()), expected)


def test_threads_may_start_the_engine_at_once() -> None:
    code = (
        "import threading, torch, mann_torch as mt\n"
        "torch.set_num_threads(1)\n"
        "loop = mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, 6))\n"
        "task = mt.Scenario(mt.Sinusoid([1.0, 0.3]), mt.arm_parameters(), 0.1)\n"
        "ends = []\n"
        "run = lambda: ends.append(mt.rollout(loop, task, engine='fused').q[-1].tolist())\n"
        "threads = [threading.Thread(target=run) for _ in range(6)]\n"
        "[t.start() for t in threads]; [t.join() for t in threads]\n"
        "print(len(ends), all(e == ends[0] for e in ends))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split() == ["6", "True"] and done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"engine": "warp"}, "engine = 'warp'"),
        ({"device": "tpu"}, "device = 'tpu'"),
        ({"device": "cuda", "engine": "torch"}, "only the fused engine"),
        ({"tape_memory": 0.0}, "tape_memory"),
        ({"motion_dt": -1.0}, "motion_dt"),
        ({"motion_dt": 1e-14}, "motion_dt"),
        ({"sample_dt": 5e-324}, "sample_dt"),
        ({"motion_dt": float("nan")}, "motion_dt"),
    ],
)
def test_bad_options_are_named(options: dict, words: str) -> None:
    with pytest.raises(mt.ConfigError, match=words):
        mt.rollout(make_loop("nn"), make_scenario(0.02), **options)


def test_without_warp_auto_goes_on_in_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fused_engine, "missing", lambda: "warp-lang cannot be used (ImportError)")
    run = mt.rollout(make_loop("nn"), make_scenario(0.02))
    assert run.engine == "eager" and "warp-lang" in run.engine_reason
    with pytest.raises(mt.ConfigError, match="warp-lang"):
        mt.rollout(make_loop("nn"), make_scenario(0.02), engine="fused")


def test_a_kernel_that_cannot_be_built_is_told_and_auto_goes_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import warp as wp

    def refuse(**_: object) -> None:
        raise RuntimeError("no room\nleft")

    monkeypatch.setattr(wp, "force_load", refuse)
    kernels._build.cache_clear()
    with caplog.at_level(logging.WARNING, "mann_torch"):
        run = mt.rollout(make_loop("nn"), make_scenario(0.02))
    assert run.engine == "eager" and "no room" in run.engine_reason
    assert len(caplog.records) == 1
    with pytest.raises(mt.KernelError, match="no room"):
        mt.rollout(make_loop("nn"), make_scenario(0.02), engine="fused")
    kernels._build.cache_clear()


def test_kept_motion_is_thinned_inside_the_kernel_and_srmse_is_not() -> None:
    loop, scenario = make_loop("soft"), make_scenario(1.0, jumps=(0.3333,))
    full, *thin = (
        mt.rollout(loop, scenario, generator=generator(), motion_dt=dt, engine=engine)
        for dt, engine in ((None, "fused"), (0.1, "fused"), (0.1, "torch"))
    )
    for run in thin:
        assert len(run.t) == 11 and torch.equal(run.step_t, full.step_t)
        rows = torch.searchsorted(full.t, run.t)
        torch.testing.assert_close(run.q, full.q[rows], rtol=1e-12, atol=1e-14)
        for after in (None, 0.2, 0.5):
            expected = mt.srmse(full, after)
            torch.testing.assert_close(mt.srmse(run, after), expected, rtol=1e-12, atol=0)
        with pytest.raises(mt.ConfigError, match="motion_dt"):
            mt.srmse(run, after=0.25)


@pytest.mark.parametrize(
    "attention",
    [
        mt.ReallocatingAttention("always"),
        pytest.param(mt.RelaxedAttention(0.05, "always"), marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_more_neurons_and_slots_than_are_unrolled(attention: mt.Attention) -> None:
    memory = mt.WorkingMemory(18, 23, attention)
    loop = mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, 23, memory))
    (gain,) = loop.controller.tune("write_gain")
    runs, slopes = [], []
    for engine in ("torch", "fused"):
        run = mt.rollout(loop, make_scenario(0.3), generator=generator(), engine=engine)
        slopes.append(torch.autograd.grad(mt.srmse(run).sum(), gain)[0])
        runs.append(run)
    assert_same(runs, 1e-9)
    torch.testing.assert_close(slopes[0], slopes[1], rtol=1e-9, atol=0)


def test_a_batch_on_two_cores_gives_the_same_bits() -> None:
    made = case("hard_state_keys", 0.2, batch=7)
    with torch.no_grad():
        one = made.run(engine="fused")
        torch.set_num_threads(2)
        two = made.run(engine="fused")
    assert torch.equal(one.q, two.q) and torch.equal(one.modes.attended, two.modes.attended)


def test_progress_counts_every_step() -> None:
    seen: list[int] = []
    loop = mt.ClosedLoop(mt.TwoLinkArm(), make_controller("nn"))
    run = mt.rollout(loop, make_scenario(0.4), progress=seen.append)
    assert run.engine == "fused" and sum(seen) == len(run.step_t) - 1


def test_equal_forms_share_a_kernel() -> None:
    forms = [
        fused.form_of(make_controller("soft"), coulomb=False, follow_reference=True)
        for _ in range(2)
    ]
    assert forms[0] == forms[1] and hash(forms[0]) == hash(forms[1])


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device on this machine")
@pytest.mark.parametrize(
    "name", ["nn", "soft", "reallocating_always_state_keys", "relaxed_always_state_keys"]
)
def test_a_gpu_gives_what_a_cpu_gives(name: str) -> None:
    made = case(name, 0.5, batch=9)
    (gain,) = made.loop.controller.tune("base_gain")
    runs = [made.run(engine="fused", device=device) for device in ("cpu", "cuda")]
    slopes = [torch.autograd.grad(mt.srmse(run).sum(), gain)[0] for run in runs]
    torch.testing.assert_close(runs[1].q, runs[0].q, rtol=1e-9, atol=1e-12)
    torch.testing.assert_close(slopes[1], slopes[0], rtol=1e-9, atol=0)
