"""Every controller can be deployed: its steps are those it takes under a clock in a loop."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.testing.controller_bench import ControllerBench, bench_of
from mann_torch.trees import leaves
from tests.contracts.test_controller_contract import CONTROLLERS_TO_CHECK

PERIOD, TICKS = 2e-3, 6
#: Of the largest command. A loop's reference model flows, a deployed one takes Heun's steps.
CLOSE, MODEL_CLOSE = 1e-11, 1e-3


class Ticks(NamedTuple):
    """What came in and went out at each tick of a loop."""

    reference: Tensor  # (K, R)
    measurement: Tensor  # (K, Y)
    command: Tensor  # (K, m)


def loop_of(b: ControllerBench, clock: bool = True) -> mt.ClosedLoop:
    return mt.ClosedLoop(
        b.plant, b.controller, clock=mt.Clock(PERIOD) if clock else None, model=b.model
    )


def in_a_loop(b: ControllerBench, order: int) -> Ticks:
    """Ticks of a clock in a rollout."""
    scenario = mt.Scenario(b.signal, b.plant.parameters_of(), TICKS * PERIOD)
    loop = loop_of(b)
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.Implicit(PERIOD), sample_dt=PERIOD, engine="torch")
        seen = mt.observe(loop, scenario, run)
    signals = b.signal(run.sample_t[:-1])
    measured = torch.cat(list(seen.measurement), dim=-1)
    return Ticks(torch.cat(signals.upto(order), dim=-1), measured[:-1], seen.input[1:])


def stepped(
    stepper: mt.Stepper, ticks: Ticks, adapt: Any = lambda k: True
) -> tuple[Tensor, Tensor]:
    """Commands (K, m) of a deployed controller, and its last state."""
    state = stepper.initial_state(ticks.reference[0], ticks.measurement[0])
    commands = []
    for k, (reference, measurement, _) in enumerate(zip(*ticks, strict=True)):
        u, state, flags = stepper.step(state, reference, measurement, adapt(k))
        assert flags == 0
        commands.append(u)
    return torch.stack(commands), state


def apart(a: Tensor, b: Tensor) -> float:
    return float((a - b).abs().max() / b.abs().max().clamp(min=1e-3))


def deployed(name: str, engine: str) -> tuple[ControllerBench, mt.Stepper]:
    b = bench_of(CONTROLLERS_TO_CHECK[name](), None, None, None)
    return b, mt.deploy(loop_of(b, clock=False), PERIOD, engine=engine)


@pytest.mark.parametrize("name", CONTROLLERS_TO_CHECK)
def test_steps_are_those_under_a_clock(name: str) -> None:
    b, stepper = deployed(name, "torch")
    ticks = in_a_loop(b, stepper.ports.order)
    found, _ = stepped(stepper, ticks)
    assert apart(found, ticks.command) < (CLOSE if b.model is None else MODEL_CLOSE)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS_TO_CHECK)
def test_compiled_steps_are_those_of_torch(name: str) -> None:
    b, stepper = deployed(name, "torch")
    compiled = mt.deploy(loop_of(b, clock=False), PERIOD)
    assert compiled.engine == "compiled", compiled.engine_reason
    ticks = in_a_loop(b, stepper.ports.order)
    (found, state), (expected, other) = (
        stepped(each, ticks, lambda k: k % 3 != 1) for each in (compiled, stepper)
    )
    assert apart(found, expected) < 1e-12
    for a, b_ in zip(
        leaves(compiled.unpacked(state)), leaves(stepper.unpacked(other)), strict=True
    ):
        torch.testing.assert_close(a, b_, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("name", CONTROLLERS_TO_CHECK)
def test_frozen_it_does_not_learn(name: str) -> None:
    """Held from the third tick on, what adapts is what it was after the second."""
    b, stepper = deployed(name, "torch")
    ticks = in_a_loop(b, stepper.ports.order)
    first = Ticks(*(x[:2] for x in ticks))
    before = stepper.unpacked(stepped(stepper, first)[1]).controller
    after = stepper.unpacked(stepped(stepper, ticks, lambda k: k < 2)[1]).controller
    # Taking what adapts from `before` changes nothing: it is there already.
    kept = b.controller.held(before, after)
    for a, c in zip(leaves(after), leaves(kept), strict=True):
        assert torch.equal(a, c)
