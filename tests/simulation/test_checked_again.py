"""What a rollout checks again: precision of what it computes with, and what a scenario holds."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.plants import ArmCoefficients
from tests.conftest import CONTROLLERS, make_controller, make_loop, make_scenario

PRECISIONS = {"float": torch.float32, "half": torch.float16, "bfloat16": torch.bfloat16}


class Stops(mt.TwoLinkArm):
    """An arm with a parameter of its own, as docs/compiling.md has it."""

    def __init__(self) -> None:
        super().__init__()
        self.stiffness = torch.nn.Parameter(torch.tensor(50.0, dtype=torch.float64))

    def load(self, q: Tensor, qd: Tensor, coefficients: ArmCoefficients) -> Tensor:
        beyond = torch.where(q.abs() > 1.2, q - 1.2 * q.sign(), 0.0)
        return super().load(q, qd, coefficients) + self.stiffness * beyond


class Learned(mt.MannController):
    """A controller with a layer of its own, made in torch's default precision."""

    def __init__(self) -> None:
        super().__init__(2, 6)
        self.extra = torch.nn.Linear(2, 2)


@pytest.mark.parametrize("change", PRECISIONS)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_loop_of_the_librarys_parts_stays_float64(name: str, change: str) -> None:
    before = mt.rollout(make_loop(name), make_scenario(0.02), engine="torch")
    loop = getattr(make_loop(name), change)()
    for _, tensor in (*loop.named_parameters(), *loop.named_buffers()):
        assert tensor.dtype in (torch.float64, torch.bool)
    run = mt.rollout(loop, make_scenario(0.02), engine="torch")
    assert torch.equal(run.q, before.q)


@pytest.mark.parametrize("engine", ["auto", "torch"])
@pytest.mark.parametrize("change", PRECISIONS)
def test_a_part_in_another_precision_is_refused_and_double_mends_it(
    change: str, engine: str
) -> None:
    loop = mt.ClosedLoop(Stops(), make_controller("nn"))
    scenario = make_scenario(0.02)
    getattr(loop, change)()
    words = rf"loop\.plant\.stiffness is {PRECISIONS[change]}; .*\.double\(\)"
    with pytest.raises(mt.DtypeError, match=words):
        mt.rollout(loop, scenario, engine=engine)
    mt.rollout(loop.double(), scenario, engine="torch")
    getattr(scenario.reference, change)()
    with pytest.raises(mt.DtypeError, match=f"reference.amplitude is {PRECISIONS[change]}"):
        mt.rollout(loop, scenario, engine=engine)
    scenario.reference.double()
    mt.rollout(loop, scenario, engine="torch")


def test_a_layer_made_in_float32_is_named_and_double_mends_it() -> None:
    loop = mt.ClosedLoop(mt.TwoLinkArm(), Learned())
    with pytest.raises(mt.DtypeError, match=r"loop\.controller\.extra\.weight is torch\.float32"):
        mt.rollout(loop, make_scenario(0.02))
    mt.rollout(loop.double(), make_scenario(0.02), engine="torch")


def test_a_constant_written_over_in_float32_is_named() -> None:
    loop = make_loop("soft")
    loop.controller.memory.write_gain.data = torch.tensor(0.5)
    told = r"loop\.controller\.approximator\.memory\.write_gain is torch.float"
    with pytest.raises(mt.DtypeError, match=told):
        mt.rollout(loop, make_scenario(0.02))


def _set(name: str, value: Callable[[Tensor], object]) -> Callable[[mt.PiecewiseConstant], None]:
    return lambda schedule: setattr(schedule, name, value(getattr(schedule, name)))


CHANGES: dict[str, tuple[Callable[[mt.PiecewiseConstant], object], type[mt.ConfigError], str]] = {
    "unsorted": (lambda s: s.times[0].fill_(0.4), mt.ConfigError, "must increase"),
    "equal": (lambda s: s.times.fill_(0.01), mt.ConfigError, "must increase"),
    "negative times": (lambda s: s.times.neg_(), mt.ConfigError, "must increase from > 0"),
    "times nan": (lambda s: s.times.fill_(math.nan), mt.ConfigError, "must increase"),
    "values nan": (lambda s: s.values.fill_(math.nan), mt.DomainError, "masses"),
    "values inf": (lambda s: s.values[-1].fill_(math.inf), mt.DomainError, "masses"),
    "a mass below 0": (lambda s: s.values[1, 0].neg_(), mt.DomainError, "masses = .*> 0"),
    "float32 values": (_set("values", Tensor.float), mt.DtypeError, "'masses': values is .*32"),
    "float32 times": (_set("times", Tensor.float), mt.DtypeError, "'masses': times is .*32"),
    "times cut": (_set("times", lambda t: t[:1]), mt.ShapeError, "one value row more"),
    "values cut": (_set("values", lambda v: v[:, :1]), mt.ShapeError, "masses has shape"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_schedule_that_was_changed_is_checked_again(name: str) -> None:
    change, kind, words = CHANGES[name]
    loop, scenario = make_loop("nn"), make_scenario(0.02, (0.005, 0.01))
    mt.rollout(loop, scenario, engine="torch")
    change(scenario.schedule["masses"])
    for engine in ("auto", "torch"):
        with pytest.raises(kind, match=words):
            mt.rollout(loop, scenario, engine=engine)
    with pytest.raises(kind, match=words):
        mt.explain(loop, scenario)


def test_whatever_else_a_scenario_holds_is_checked_again() -> None:
    loop, noise = make_loop("nn"), mt.MeasurementNoise(torch.full((2, 2), 0.1, dtype=torch.float64))
    plain = make_scenario(0.02)
    start = mt.PlantState(*(torch.zeros(2, dtype=torch.float64) for _ in range(2)))
    own = mt.arm_parameters(torch.ones(2, dtype=torch.float64))
    scenario = mt.Scenario(plain.reference, own, 0.02, {}, start, noise)
    mt.rollout(loop, scenario, engine="torch")
    changes = [
        (start.q, math.nan, "start"),
        (scenario.horizon, -1.0, "horizon"),
        (noise.std, -1.0, "std"),
        (own.masses, 0.0, "masses"),
    ]
    for tensor, value, word in changes:
        kept = tensor.clone()
        tensor.copy_(torch.full_like(tensor, value)) if tensor.dim() else tensor.fill_(value)
        with pytest.raises(mt.ConfigError, match=word):
            mt.rollout(loop, scenario, engine="torch")
        tensor.copy_(kept)
    mt.rollout(loop, scenario, engine="torch")
    scenario.schedule["mass"] = mt.PiecewiseConstant([0.01], [[1.0], [2.0]])  # type: ignore[index]
    with pytest.raises(mt.ConfigError, match="schedule of 'mass'"):
        mt.rollout(loop, scenario, engine="torch")
