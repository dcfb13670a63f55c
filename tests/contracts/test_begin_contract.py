"""A rollout that begins where another ended goes on as if there had been no end."""

from __future__ import annotations

import io
from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.errors import ConfigError, KindError, RecordError, ShapeError
from mann_torch.signals import Polynomial
from mann_torch.testing.controller_bench import bench_of
from mann_torch.trees import leaves
from mann_torch.types import Snapshot
from tests.conftest import generator, make_loop, make_scenario
from tests.contracts.test_controller_contract import CONTROLLERS_TO_CHECK

DT, STEPS = 2e-3, 5


def standing(plant: mt.Plant, steps: int, batch: int = 2) -> mt.Scenario:
    """What is to be followed stands still: time may begin anew."""
    there = torch.linspace(0.02, 0.05, batch * len(plant.outputs)).double().reshape(batch, -1)
    return mt.Scenario(Polynomial(there.unsqueeze(-2)), plant.parameters_of(), steps * DT)


def rolled(loop: mt.ClosedLoop, steps: int, engine: str = "torch", **given: Any) -> mt.Trajectory:
    with torch.no_grad():
        return mt.rollout(
            loop, standing(loop.plant, steps), mt.Implicit(DT), engine=engine, **given
        )


def same(one: mt.Trajectory, other: mt.Trajectory) -> bool:
    """Every number at the end, to rounding."""
    pairs = zip(leaves(one.end), leaves(other.end), strict=True)
    return all(
        torch.allclose(a.double(), b.double(), rtol=1e-11, atol=1e-12, equal_nan=True)
        for a, b in pairs
    )


@pytest.mark.parametrize("name", CONTROLLERS_TO_CHECK)
def test_every_controller_goes_on(name: str) -> None:
    b = bench_of(CONTROLLERS_TO_CHECK[name](), None, None, None)
    loop = mt.ClosedLoop(b.plant, b.controller, model=b.model)
    first = rolled(loop, STEPS, generator=generator(0))
    whole = rolled(loop, 2 * STEPS, generator=generator(0))
    second = rolled(loop, STEPS, begin=first.end)
    assert same(second, whole)
    if leaves(first.states.controller):
        assert not same(rolled(loop, STEPS, generator=generator(0)), whole)


PARTS: dict[str, dict[str, Any]] = {
    "a lagging actuator": {"actuator": mt.Actuator(2, lag=0.05, limit=30.0)},
    "a sensor whose samples are on their way": {"sensor": mt.Sensor(period=2e-3, delay=4e-3)},
    "a clock": {"clock": mt.Clock(2e-3)},
    "a clock that holds lines": {"clock": mt.Clock(2e-3, hold="first")},
    "a reference model": {"model": mt.SecondOrderModel(2, 3.0)},
}


@pytest.mark.parametrize("engine", ["torch", "compiled"])
@pytest.mark.parametrize("name", PARTS)
def test_what_stands_between_goes_on(name: str, engine: str) -> None:
    loop = mt.ClosedLoop(mt.TwoLinkArm(), make_loop("hard").controller, **PARTS[name])
    first = rolled(loop, STEPS, engine, generator=generator(0))
    whole = rolled(loop, 2 * STEPS, engine, generator=generator(0))
    assert same(rolled(loop, STEPS, engine, begin=first.end), whole)


def test_through_a_file_and_for_a_whole_batch() -> None:
    loop = make_loop("reallocating_always")
    first = rolled(loop, STEPS, generator=generator(0))
    file = io.BytesIO()
    torch.save(first.end, file)
    file.seek(0)
    loaded = torch.load(file, weights_only=True)
    assert same(rolled(loop, STEPS, begin=loaded), rolled(loop, STEPS, begin=first.end))
    # One end for all samples of a scenario, and samples of their own for one scenario.
    one = type(loaded)(*(_row(tree, 0) for tree in loaded))
    both, row = rolled(loop, STEPS, begin=one), rolled(loop, STEPS, begin=first.end)
    assert torch.equal(both.q[:, 0], row.q[:, 0]) and not torch.equal(both.q[:, 1], row.q[:, 1])


def _row(tree: Any, i: int) -> Any:
    if tree is None or isinstance(tree, Tensor):
        return None if tree is None else tree[i]
    return type(tree)(*(_row(branch, i) for branch in tree))


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_gradients_go_through_the_end_of_one_into_the_other(engine: str) -> None:
    loop = make_loop("soft")
    (gain,) = loop.tune("write_gain")

    def run(steps: int, **given: Any) -> mt.Trajectory:
        scenario = standing(loop.plant, steps)
        return mt.rollout(loop, scenario, mt.Implicit(DT), engine=engine, **given)

    first = run(STEPS, generator=generator(0))
    (split,) = torch.autograd.grad(run(STEPS, begin=first.end).q[-1].sum(), gain)
    (whole,) = torch.autograd.grad(run(2 * STEPS, generator=generator(0)).q[-1].sum(), gain)
    assert whole != 0.0 and torch.allclose(split, whole, rtol=1e-9, atol=0.0)


def test_what_is_no_end_of_this_loop_is_named() -> None:
    loop, scenario = make_loop("hard"), make_scenario(0.02)
    run = mt.rollout(loop, scenario, engine="torch")
    weights = loop.controller.initial_weights(())
    for given, kind, said in (
        ({"begin": run}, KindError, "begin .* a Snapshot, as `Trajectory.end` gives it"),
        ({"begin": run.end, "weights": weights}, ConfigError, "begin has weights"),
        ({"begin": run.end, "generator": generator(0)}, ConfigError, "begin has weights"),
        (
            {"begin": mt.rollout(make_loop("nn"), scenario).end},
            ConfigError,
            "begin is not of this loop, or not of this batch: state.controller.memory is a None",
        ),
        (
            {"begin": mt.rollout(make_loop("hard", n_slots=3), scenario).end},
            ConfigError,
            r"begin is not of this loop.*state.controller.memory.mu has shape \(3, 6\)",
        ),
        (
            {"begin": mt.rollout(loop, scenario, batch_shape=(3,)).end, "batch_shape": (2,)},
            ShapeError,
            "do not broadcast",
        ),
    ):
        with pytest.raises(kind, match=said):
            mt.rollout(loop, scenario, **given)
    with pytest.raises(RecordError, match="states are kept until t = 0 s, not to the end"):
        _ = mt.rollout(loop, scenario, sample_until=0.0).end
    assert isinstance(run.end, Snapshot)
