"""Long rollouts on the torch engine: a tape of bounded size, and the same derivatives."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.simulation.engines import torch_engine
from tests.conftest import make_loop, make_scenario
from tests.simulation.loops import case, freed
from tests.simulation.test_compiled_gradients import gradients, loss_of

ROOT = Path(__file__).parents[2]
WHOLE, CUT = 1e15, 1.0  # bytes of tape


def nodes_behind(result: Tensor) -> int:
    stack, seen = [result.grad_fn], set()
    while stack:
        node = stack.pop()
        if node is not None and node not in seen:
            seen.add(node)
            stack.extend(following for following, _ in node.next_functions)
    return len(seen)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("soft", {}),
        ("reallocating_always", {"gradient": "hybrid"}),
        pytest.param("relaxed_always", {"effort_after": 0.1}, marks=pytest.mark.slow),
        ("nn", {"noise": True}),
    ],
)
def test_a_tape_in_blocks_gives_the_same_derivatives(name: str, options: dict[str, Any]) -> None:
    options = dict(options)
    made, free = freed(case(name, 0.4))
    if options.pop("noise", False):
        noise = mt.MeasurementNoise([1e-3, 1e-2], seed=[1, 2, 3])
        made = made._replace(scenario=dataclasses.replace(made.scenario, noise=noise))
    found = [
        gradients(made, free, engine="torch", tape_memory=memory, **options)
        for memory in (WHOLE, CUT)
    ]
    assert found[0].keys() == found[1].keys()
    for key, gradient in found[0].items():
        torch.testing.assert_close(found[1][key], gradient, rtol=1e-11, atol=1e-14)


def test_values_are_the_same_bits_and_the_tape_is_short() -> None:
    made, _ = freed(case("reallocating_always", 0.8))
    runs = [made.run(engine="torch", tape_memory=memory) for memory in (WHOLE, CUT)]
    assert torch.equal(runs[0].q, runs[1].q) and torch.equal(runs[0].qd, runs[1].qd)
    assert runs[0].final_mode.switches.tolist() == runs[1].final_mode.switches.tolist()
    long, short = (nodes_behind(loss_of(run).sum()) for run in runs)
    assert short < 0.2 * long


def test_effort_of_a_tape_in_blocks() -> None:
    found = []
    for memory in (WHOLE, CUT):
        made, free = freed(case("soft", 0.3))
        run = made.run(engine="torch", tape_memory=memory, effort_after=0.1)
        effort = mt.input_rate(run).sum() + mt.peak_input(run).sum()
        found.append(torch.autograd.grad(effort, [free["base_gain"], free["masses"]]))
    for mine, other in zip(*found, strict=True):
        assert bool(mine.any())
        torch.testing.assert_close(mine, other, rtol=1e-11, atol=0)


def test_second_derivatives_and_two_backward_passes() -> None:
    found = []
    for memory in (WHOLE, CUT):
        made, free = freed(case("soft", 0.2, batch=2))
        wanted = [free[key] for key in ("base_gain", "write_gain", "masses", "W")]
        loss = loss_of(made.run(engine="torch", tape_memory=memory)).sum()
        slopes = torch.autograd.grad(loss, wanted, create_graph=True)
        bent = sum(slope.square().sum() for slope in slopes)
        found.append(torch.autograd.grad(bent, wanted, retain_graph=True))
        found.append(torch.autograd.grad(loss, wanted))
    for a, b in zip(found[0] + found[1], found[2] + found[3], strict=True):
        torch.testing.assert_close(a, b, rtol=1e-9, atol=0)


class Hidden(mt.TwoLinkArm):
    """Gravity scaled by a number that the module does not own up to."""

    def __init__(self) -> None:
        super().__init__()
        self.hidden = [torch.tensor(0.7, dtype=torch.float64, requires_grad=True)]

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        return super().load(q, qd, coefficients) * self.hidden[0]


def test_a_tensor_that_no_module_owns_keeps_its_gradient() -> None:
    slopes = []
    for memory in (WHOLE, CUT):
        plant = Hidden()
        loop = mt.ClosedLoop(plant, make_loop("nn").controller)
        (gain,) = loop.controller.tune("base_gain")
        run = mt.rollout(loop, make_scenario(0.3), engine="torch", tape_memory=memory)
        slopes.append(torch.autograd.grad(run.q.square().sum(), [plant.hidden[0], gain]))
    assert float(slopes[0][0]) != 0.0
    assert all(torch.equal(a, b) for a, b in zip(*slopes, strict=True))


class Derived(mt.TwoLinkArm):
    """Gravity scaled by a number made of a parameter once and for all."""

    def __init__(self) -> None:
        super().__init__()
        self.scale = torch.nn.Parameter(torch.tensor(0.9, dtype=torch.float64))
        self.square = self.scale.square()

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        return super().load(q, qd, coefficients) * self.square


class Part(torch.nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.scale = torch.nn.Parameter(torch.tensor(0.9, dtype=torch.float64))


class Tied(mt.TwoLinkArm):
    """One parameter under two names."""

    def __init__(self) -> None:
        super().__init__()
        self.one, self.two = Part(), Part()
        self.two.scale = self.one.scale

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        return super().load(q, qd, coefficients) * self.one.scale * self.two.scale


class Drawing(mt.TwoLinkArm):
    """Gravity that trembles."""

    def __init__(self) -> None:
        super().__init__()
        self.scale = torch.nn.Parameter(torch.tensor(0.1, dtype=torch.float64))

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        return super().load(q, qd, coefficients) * (1.0 + self.scale * torch.randn(()).double())


@pytest.mark.parametrize("kind", [Derived, Tied, Drawing])
def test_what_cannot_be_computed_again_keeps_its_tape(kind: type[mt.Plant]) -> None:
    slopes = []
    for memory in (WHOLE, CUT):
        plant = kind()
        loop = mt.ClosedLoop(plant, make_loop("nn").controller)
        torch.manual_seed(3)
        run = mt.rollout(loop, make_scenario(0.3), engine="torch", tape_memory=memory)
        (owned,) = plant.parameters()
        slopes.append(torch.autograd.grad(run.q.square().sum(), owned)[0])
    assert bool(slopes[0].any()) and torch.equal(*slopes)


class Counting(mt.TwoLinkArm):
    """Heavier by what it has counted so far."""

    def __init__(self, in_place: bool) -> None:
        super().__init__()
        self.in_place = in_place
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        if self.in_place:
            self.count += 1.0
        else:
            self.count = self.count + 1.0
        return super().load(q, qd, coefficients) * (1.0 + 1e-3 * self.count.clone())


@pytest.mark.parametrize("in_place", [True, False])
def test_a_loop_that_counts_is_not_run_twice(in_place: bool) -> None:
    ends = []
    for memory in (WHOLE, CUT):
        plant = Counting(in_place)
        loop = mt.ClosedLoop(plant, make_loop("nn").controller)
        (gain,) = loop.controller.tune("base_gain")
        run = mt.rollout(loop, make_scenario(0.3), engine="torch", tape_memory=memory)
        calls = float(plant.count)
        torch.autograd.grad(run.q.square().sum(), gain)
        assert float(plant.count) == calls > 0
        ends.append(run.q.detach())
    assert torch.equal(*ends)
    run = mt.rollout(mt.ClosedLoop(Counting(in_place), loop.controller), make_scenario(0.3))
    assert run.engine == "eager", run.engine_reason


class Tallying(mt.TwoLinkArm):
    """The same with a Python number, which nobody sees."""

    tally = 0

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        self.tally += 1
        return super().load(q, qd, coefficients) * (1.0 + 1e-3 * self.tally)


class Late(Hidden):
    """Asks for the hidden number once the arm has moved."""

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        load = mt.TwoLinkArm.load(self, q, qd, coefficients)
        return load * self.hidden[0] if bool((q.abs() > 0.05).any()) else load


@pytest.mark.parametrize(("kind", "words"), [(Tallying, "draws or counts"), (Late, "no module")])
def test_what_shows_too_late_is_refused(kind: type[mt.Plant], words: str) -> None:
    loop = mt.ClosedLoop(kind(), make_loop("nn").controller)
    (gain,) = loop.controller.tune("base_gain")
    run = mt.rollout(loop, make_scenario(0.5), engine="torch", tape_memory=CUT)
    with pytest.raises(mt.SolverError, match=words):
        torch.autograd.grad(run.q.square().sum(), gain)


@pytest.mark.slow
def test_a_module_changed_later_changes_no_gradient() -> None:
    made, free = freed(case("reallocating_always", 0.3))
    memory = made.loop.controller.memory
    assert memory is not None
    found = []
    for tape in (WHOLE, CUT):
        runs = []
        for reset in ("scaled", "raw"):
            memory.reset = reset
            runs.append(made.run(engine="torch", tape_memory=tape))
        loss = sum(loss_of(run).sum() for run in runs)
        found.append(torch.autograd.grad(loss, [free["base_gain"], free["W"]]))
    for a, b in zip(*found, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-11, atol=0)


def test_a_sample_that_diverges_leaves_its_mates_their_gradients() -> None:
    found = []
    for memory in (WHOLE, CUT):
        made = case("soft", 0.3)
        W = made.weights.W.clone()
        W[1] = 1e9
        made = made._replace(weights=made.weights._replace(W=W))
        (gain,) = made.loop.controller.tune("write_gain")
        run = made.run(engine="torch", tape_memory=memory)
        assert run.status[1] != 0 and run.status[0] == run.status[2] == 0
        found.append(torch.autograd.grad(run.q[:, [0, 2]].square().sum(), gain)[0])
    torch.testing.assert_close(found[1], found[0], rtol=1e-11, atol=0)


def test_forward_mode_sees_the_whole() -> None:
    made = case("soft", 0.2, batch=1)

    def loss(amplitude: Tensor) -> Tensor:
        scenario = dataclasses.replace(
            made.scenario, reference=mt.Sinusoid(amplitude, [0.5, 0.7], [0.1, -0.2])
        )
        return loss_of(made._replace(scenario=scenario).run(engine="torch", tape_memory=CUT)).sum()

    at = torch.tensor([1.0, 0.3], dtype=torch.float64, requires_grad=True)
    along = torch.tensor([0.7, -0.4], dtype=torch.float64)
    _, forwards = torch.func.jvp(loss, (at.detach(),), (along,))
    (backwards,) = torch.autograd.grad(loss(at), at)
    torch.testing.assert_close(forwards, backwards @ along, rtol=1e-9, atol=0)


def test_short_rollouts_keep_their_tape() -> None:
    made, _ = freed(case("soft", 1.0))
    task_steps = round(1.0 / mt.Implicit().dt)
    assert task_steps * torch_engine.NODES < 256e6
    default, whole = (made.run(engine="torch", **o) for o in ({}, {"tape_memory": WHOLE}))
    assert nodes_behind(loss_of(default).sum()) == nodes_behind(loss_of(whole).sum())


CODE = """
import torch, mann_torch as mt
from tests.simulation.loops import case, freed
made, free = freed(case("{name}", 60.0, batch=1))
run = made.run(engine="torch", sample_dt=1.0, gradient="{gradient}")
slopes = torch.autograd.grad(mt.srmse(run).sum(), list(free.values()), allow_unused=True)
assert all(bool(torch.isfinite(s).all()) for s in slopes if s is not None)
(line,) = [l for l in open("/proc/self/status") if l.startswith("VmHWM")]
print(int(line.split()[1]) * 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("name", "gradient"), [("soft", "plain"), ("reallocating_always", "hybrid")]
)
def test_a_gradient_over_a_minute_fits_in_a_gigabyte(name: str, gradient: str) -> None:
    code = CODE.format(name=name, gradient=gradient)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    print(done.stdout)
    assert int(done.stdout) < 1e9
