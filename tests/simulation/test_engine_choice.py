"""Which engine is taken, and what is kept."""

from __future__ import annotations

import logging
import random
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.compiled.host import kernels as host
from mann_torch.signals import Forces
from mann_torch.simulation.conditions import Conditions
from mann_torch.simulation.engines import compiled_engine
from mann_torch.types import Comparison, LoopState, Measurement
from tests.conftest import generator, make_controller, make_loop, make_scenario
from tests.simulation.loops import NAMES, case
from tests.simulation.test_compiled_parity import assert_same


class Lukewarm(mt.SoftAttention):
    """An attention of the user's own."""

    def forward(self, comparison: Comparison, active: torch.Tensor) -> torch.Tensor:
        return active.double() / active.sum(dim=-1, keepdim=True)


class Deciding(Lukewarm):
    """One that decides on data in Python."""

    def forward(self, comparison: Comparison, active: torch.Tensor) -> torch.Tensor:
        if comparison.query.sum() > 0:
            return super().forward(comparison, active)
        return super().forward(comparison, active)


class Holding(Lukewarm):
    """One with a tensor that is neither parameter nor buffer."""

    def __init__(self) -> None:
        super().__init__()
        self.scale = [torch.ones(3, dtype=torch.float64)]

    def forward(self, comparison: Comparison, active: torch.Tensor) -> torch.Tensor:
        return super().forward(comparison, active) * self.scale[0]


class Spectral(Lukewarm):
    """One with an operation that has no compiled form."""

    def forward(self, comparison: Comparison, active: torch.Tensor) -> torch.Tensor:
        spread = torch.linalg.eigvalsh(comparison.keys @ comparison.keys.mT).sum()
        return super().forward(comparison, active) + 0.0 * spread


class Drawing(Lukewarm):
    """One whose numbers Python draws anew at each call."""

    def forward(self, comparison: Comparison, active: torch.Tensor) -> torch.Tensor:
        return super().forward(comparison, active) * (1.0 + 0.1 * random.random())


ROOT = Path(__file__).parents[2]


def own_loop(attention: mt.Attention) -> mt.ClosedLoop:
    memory = mt.WorkingMemory(3, 6, attention)
    return mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, 6, memory))


def test_auto_takes_the_compiled_engine_and_says_so() -> None:
    run = mt.rollout(make_loop("hard"), make_scenario(0.02))
    assert run.engine == "compiled" and run.engine_reason == compiled_engine.REASON
    run = mt.rollout(make_loop("hard"), make_scenario(0.02), engine="torch")
    assert run.engine == "eager" and run.engine_reason == "asked for"


def test_a_part_of_ones_own_is_compiled() -> None:
    runs = [
        mt.rollout(own_loop(Lukewarm()), make_scenario(0.2), generator=generator(), engine=engine)
        for engine in ("torch", "auto")
    ]
    assert [run.engine for run in runs] == ["eager", "compiled"]
    torch.testing.assert_close(runs[1].q, runs[0].q, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    ("attention", "words"),
    [
        (
            Deciding,
            "a decision on data .* in Deciding, test_engine_choice.py:.*: if comparison.query.sum",
        ),
        (Holding, "neither parameter nor buffer.*test_engine_choice.py:.*self.scale"),
        (Spectral, "_linalg_eigh.* has no compiled form.*test_engine_choice.py:.*eigvalsh"),
        (Drawing, "differs from eager torch.*Python draws"),
    ],
)
def test_what_cannot_be_compiled_is_named_and_runs_in_torch(
    attention: type[mt.Attention], words: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "mann_torch"):
        run = mt.rollout(own_loop(attention()), make_scenario(0.02))
    assert run.engine == "eager" and re.search(words, run.engine_reason), run.engine_reason
    assert not caplog.records  # five steps are no wait
    with pytest.raises(mt.ConfigError, match="engine = 'compiled': "):
        mt.rollout(own_loop(attention()), make_scenario(0.02), engine="compiled")


def test_a_long_run_in_torch_is_told_of_once(caplog: pytest.LogCaptureFixture) -> None:
    rollout_module = sys.modules["mann_torch.simulation.rollout"]
    rollout_module._said.cache_clear()  # type: ignore[attr-defined]
    with caplog.at_level(logging.WARNING, "mann_torch"):
        for _ in range(2):
            mt.rollout(own_loop(Deciding()), make_scenario(0.6), mt.Implicit(1e-3))
    assert len(caplog.records) == 1 and "torch engine takes over" in caplog.text


def test_an_adaptive_solver_runs_in_torch() -> None:
    run = mt.rollout(make_loop("nn"), make_scenario(0.01), mt.Odeint("dopri5"))
    assert run.engine == "eager" and "dopri5" in run.engine_reason
    with pytest.raises(mt.ConfigError, match="dopri5"):
        mt.rollout(make_loop("nn"), make_scenario(0.02), mt.Odeint("dopri5"), engine="compiled")


class Drifting(mt.ClosedLoop):
    """A loop of the user's own: the measurement is off by a millimetre."""

    def seen(self, state: LoopState, here: Conditions, forces: Forces | None) -> Measurement:
        found = super().seen(state, here, forces)
        return Measurement(found.q + 1e-3, found.qd)


def test_a_loop_of_ones_own_is_compiled_and_its_changes_count() -> None:
    loop = Drifting(mt.TwoLinkArm(), make_controller("nn"))
    runs = [mt.rollout(loop, make_scenario(0.2), engine=engine) for engine in ("compiled", "torch")]
    torch.testing.assert_close(runs[0].q, runs[1].q, rtol=1e-13, atol=1e-14)
    plain = mt.rollout(make_loop("nn"), make_scenario(0.2), engine="compiled")
    assert float((runs[0].q - plain.q).abs().max()) > 1e-5


def test_a_number_of_a_module_changed_between_rollouts_counts() -> None:
    loop, found = make_loop("nn"), []
    for gravity in (9.8, 0.0, 9.8):
        loop.plant.gravity = gravity
        pair = [mt.rollout(loop, make_scenario(0.1), engine=e).q for e in ("compiled", "torch")]
        torch.testing.assert_close(*pair, rtol=1e-13, atol=1e-14)
        found.append(pair[0])
    assert torch.equal(found[0], found[2]) and not torch.equal(found[0], found[1])


class Weighted(Lukewarm):
    """One with numbers in an array."""

    def __init__(self) -> None:
        super().__init__()
        self.shares = np.array([0.5, 0.3, 0.2])

    def forward(self, comparison: Comparison, active: torch.Tensor) -> torch.Tensor:
        return super().forward(comparison, active) * float(self.shares[0]) * 2.0


def test_an_array_of_a_module_changed_in_place_counts() -> None:
    attention, found = Weighted(), []
    loop = own_loop(attention)
    for share in (0.5, 0.4):
        attention.shares[0] = share
        pair = [
            mt.rollout(loop, make_scenario(0.1), generator=generator(), engine=e).qd
            for e in ("compiled", "torch")
        ]
        torch.testing.assert_close(*pair, rtol=1e-13, atol=1e-14)
        found.append(pair[0])
    assert not torch.equal(*found)


def test_a_derivative_is_that_of_the_numbers_that_were_run() -> None:
    slopes = []
    for later in (9.8, 0.0):
        loop = make_loop("nn")
        (gain,) = loop.controller.tune("base_gain")
        loss = mt.rollout(loop, make_scenario(0.1), engine="compiled").q.square().sum()
        loop.plant.gravity = later
        slopes.append(torch.autograd.grad(loss, gain)[0])
    assert torch.equal(slopes[0], slopes[1])


def test_hooks_and_empty_batches_go_to_the_torch_engine() -> None:
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
        "run = lambda: ends.append(mt.rollout(loop, task, engine='compiled').q[-1].tolist())\n"
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
        ({"device": "cuda", "engine": "torch"}, "only the compiled engine"),
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
    monkeypatch.setattr(
        compiled_engine, "missing", lambda: "warp-lang cannot be used (ImportError)"
    )
    run = mt.rollout(make_loop("nn"), make_scenario(0.02))
    assert run.engine == "eager" and "warp-lang" in run.engine_reason
    with pytest.raises(mt.ConfigError, match="warp-lang"):
        mt.rollout(make_loop("nn"), make_scenario(0.02), engine="compiled")


def test_a_kernel_that_cannot_be_built_is_told_and_auto_goes_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import warp as wp

    def refuse(**_: object) -> None:
        raise RuntimeError("no room\nleft")

    monkeypatch.setattr(wp, "force_load", refuse)
    host._build.cache_clear()
    with caplog.at_level(logging.WARNING, "mann_torch"):
        run = mt.rollout(make_loop("nn"), make_scenario(0.02))
        assert run.engine == "eager" and "no room" in run.engine_reason
        mt.rollout(make_loop("nn"), make_scenario(3.0))
    assert len(caplog.records) == 1
    with pytest.raises(mt.KernelError, match="no room"):
        mt.rollout(make_loop("nn"), make_scenario(0.02), engine="compiled")
    host._build.cache_clear()


def test_kept_motion_is_thinned_inside_the_kernel_and_srmse_is_not() -> None:
    loop, scenario = make_loop("soft"), make_scenario(1.0, jumps=(0.3333,))
    full, *thin = (
        mt.rollout(loop, scenario, generator=generator(), motion_dt=dt, engine=engine)
        for dt, engine in ((None, "compiled"), (0.1, "compiled"), (0.1, "torch"))
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
    for engine in ("torch", "compiled"):
        run = mt.rollout(loop, make_scenario(0.3), generator=generator(), engine=engine)
        slopes.append(torch.autograd.grad(mt.srmse(run).sum(), gain)[0])
        runs.append(run)
    assert_same(runs, 1e-9)
    torch.testing.assert_close(slopes[0], slopes[1], rtol=1e-9, atol=0)


def test_a_batch_on_two_cores_gives_the_same_bits() -> None:
    made = case("hard_state_keys", 0.2, batch=7)
    with torch.no_grad():
        one = made.run(engine="compiled")
        torch.set_num_threads(2)
        two = made.run(engine="compiled")
    assert torch.equal(one.q, two.q) and torch.equal(one.modes.attended, two.modes.attended)


def test_progress_counts_every_step() -> None:
    seen: list[int] = []
    loop = mt.ClosedLoop(mt.TwoLinkArm(), make_controller("nn"))
    run = mt.rollout(loop, make_scenario(0.4), progress=seen.append)
    assert run.engine == "compiled" and sum(seen) == len(run.step_t) - 1


def test_equal_loops_share_a_program() -> None:
    mt.rollout(make_loop("soft"), make_scenario(0.02))
    count = len(compiled_engine._PROGRAMS)
    mt.rollout(make_loop("soft"), make_scenario(0.5), batch_shape=(4,))
    assert len(compiled_engine._PROGRAMS) == count


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device on this machine")
@pytest.mark.parametrize(
    "name", ["nn", "soft", "reallocating_always_state_keys", "relaxed_always_state_keys"]
)
def test_a_gpu_gives_what_a_cpu_gives(name: str) -> None:
    made = case(name, 0.5, batch=9)
    (gain,) = made.loop.controller.tune("base_gain")
    runs = [made.run(engine="compiled", device=device) for device in ("cpu", "cuda")]
    slopes = [torch.autograd.grad(mt.srmse(run).sum(), gain)[0] for run in runs]
    torch.testing.assert_close(runs[1].q, runs[0].q, rtol=1e-9, atol=1e-12)
    torch.testing.assert_close(slopes[1], slopes[0], rtol=1e-9, atol=0)


@pytest.mark.parametrize(
    "name",
    [n if n in ("nn", "soft", "hard") else pytest.param(n, marks=pytest.mark.slow) for n in NAMES],
)
def test_every_controller_is_compiled_from_a_fresh_start_with_every_gradient(name: str) -> None:
    """As users have it: slots all alike, weights at their first draw, arm at rest."""
    loop = make_loop(name)
    loop.controller.tune(*loop.controller.constants())
    scenario = make_scenario(0.1, jumps=(0.05,))
    run = mt.rollout(loop, scenario, generator=generator(), batch_shape=(6,), effort_after=0.0)
    assert run.engine == "compiled", run.engine_reason
    (mt.srmse(run).sum() + mt.input_rate(run).sum()).backward()


@pytest.mark.checkout
def test_slots_that_tie_at_the_start_do_not_send_a_run_to_the_torch_engine(tmp_path: Path) -> None:
    """Of slots that hold the same, rounding decides which is attended: no sign of a wrong step."""
    arguments = ["scenario=5", "controller=soft", "horizon=0.05", "output.tensorboard=false"]
    command = [sys.executable, "-m", "experiments.simulate", *arguments, "output.figures=false"]
    done = subprocess.run(
        [*command, f"run_dir={tmp_path / 'run'}"], cwd=ROOT, capture_output=True, text=True
    )
    assert "(compiled)" in done.stdout, done.stderr
