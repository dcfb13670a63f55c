"""The loop's own parts together: both engines, batches, tapes in blocks, samples that diverge."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.signals import Disturbance, Sinusoid, Steps
from tests.conftest import generator, make_controller
from tests.parts.linear import loop, scenario


def all_parts() -> dict[str, Any]:
    return {
        "actuator": mt.Actuator(1, 6.0, lag=0.01, rate_limit=300.0),
        "sensor": mt.Sensor(1e-3, delay=0.02, period=0.01),
        "clock": mt.Clock(0.01, 0.002, "first"),
        "model": mt.SecondOrderModel(1, 5.0),
    }


def disturbed(batch: tuple[int, ...] = ()) -> mt.Scenario:
    """A step to follow, disturbances everywhere, noise; in a batch, of each sample its own."""
    size = torch.linspace(1.0, 2.0, max(1, *batch, 1), dtype=torch.float64)
    size = size.reshape(*batch, 1) if batch else size
    seeds = torch.arange(batch[0]) if batch else 0
    return scenario(
        reference=Steps([0.1], [[0.0], [1.0]]),
        disturbance=Disturbance(
            input=Sinusoid(size, 5.0),
            output=Sinusoid([1e-2, 1e-2], 9.0),
            state=Steps([0.25], [[0.0, 0.0], [0.0, 1.0]]),
        ),
        noise=mt.MeasurementNoise([1e-3, 1e-3], seeds),
    )


def test_all_parts_agree_on_both_engines_and_batches_are_singles() -> None:
    names = ("upper", "lag", "rate_limit", "frequency", "damping", "feedback")
    runs, slopes = {}, {}
    for engine in ("torch", "compiled"):
        made = loop(**all_parts())
        made.tune(*names)
        run = mt.rollout(made, disturbed((3,)), engine=engine, effort_after=0.0)
        cost = mt.srmse(run).sum() + 1e-3 * mt.input_rate(run).sum()
        free = [made.constant(name) for name in names]
        slopes[engine] = torch.autograd.grad(cost, free, materialize_grads=True)
        runs[engine] = run
    a, b = runs["torch"], runs["compiled"]
    assert b.engine == "compiled", b.engine_reason
    torch.testing.assert_close(a.plant.x, b.plant.x, rtol=0, atol=1e-12)
    torch.testing.assert_close(a.followed, b.followed, rtol=0, atol=1e-12)
    for name, mine, other in zip(names, slopes["torch"], slopes["compiled"], strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-10, atol=1e-13, msg=name)
    with torch.no_grad():
        for i in range(3):
            one = mt.rollout(loop(**all_parts()), disturbed((3,)).select([i]))
            assert torch.equal(one.plant.x[:, 0], b.plant.x[:, i])
    assert not torch.equal(b.plant.x[:, 0], b.plant.x[:, 1])


def test_a_tape_in_blocks_gives_the_same_gradient() -> None:
    found = []
    for memory in (256e6, 3e4):
        made = loop(**all_parts())
        made.tune("lag", "frequency", "feedback")
        run = mt.rollout(made, disturbed(), engine="torch", tape_memory=memory)
        free = [made.constant(name) for name in ("lag", "frequency", "feedback")]
        found.append((run.plant.x, *torch.autograd.grad(mt.srmse(run).sum(), free)))
    for whole, cut in zip(*found, strict=True):
        torch.testing.assert_close(whole, cut, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_a_sample_that_diverges_leaves_its_mates(engine: str) -> None:
    """Held by a clock with the wrong sign; the gradient of its mate is as without it."""
    found: list[tuple[Tensor, Tensor]] = []
    for gains in ([[4.0, 3.0], [-9e3, -9e3]], [[4.0, 3.0]]):
        parts = all_parts()
        del parts["actuator"]
        made = loop(**parts)
        made.initialize(feedback=torch.tensor(gains, dtype=torch.float64))
        made.tune("feedback")
        run = mt.rollout(made, disturbed(), engine=engine)
        assert run.status.tolist()[0] == 0 and all(run.status.tolist()[1:])
        (slope,) = torch.autograd.grad(
            run.output[-1, 0].square().sum(), [made.constant("feedback")]
        )
        found.append((run.plant.x[:, 0], slope))
    assert torch.equal(found[0][0], found[1][0])
    torch.testing.assert_close(found[0][1][0], found[1][1][0], rtol=1e-12, atol=0)
    assert torch.equal(found[0][1][1], torch.zeros(2, dtype=torch.float64))


def test_hybrid_is_refused_by_name_where_something_samples() -> None:
    controller = make_controller("hard")
    given = mt.Scenario(mt.Sinusoid([1.0, 0.3]), mt.arm_parameters(), 0.1)
    for part in ({"clock": mt.Clock(0.01)}, {"sensor": mt.Sensor(period=0.01)}):
        made = mt.ClosedLoop(mt.TwoLinkArm(), controller, **part)
        with pytest.raises(mt.errors.ConfigError, match="with a clock or a sensor"):
            mt.rollout(made, given, gradient="hybrid")


@pytest.mark.slow
def test_hybrid_steps_agree_with_an_actuator_a_model_and_a_disturbance() -> None:
    runs = []
    for engine in ("torch", "compiled"):
        made = mt.ClosedLoop(
            mt.TwoLinkArm(), make_controller("reallocating_initial"),
            actuator=mt.Actuator(2, 60.0, lag=0.005), model=mt.SecondOrderModel(2, 5.0),
        )  # fmt: skip
        given = mt.Scenario(
            Steps([0.2], [[0.0, 0.0], [1.0, 0.5]]), mt.arm_parameters(), 0.6,
            disturbance=Disturbance(input=Sinusoid([3.0, 1.0], 5.0)),
        )  # fmt: skip
        with torch.no_grad():
            runs.append(
                mt.rollout(made, given, generator=generator(), engine=engine, gradient="hybrid")
            )
    torch.testing.assert_close(runs[0].q, runs[1].q, rtol=0, atol=1e-11)
    assert runs[1].engine == "compiled"


def test_scenarios_with_disturbances_stack_and_select() -> None:
    alone = disturbed()
    twice = dataclasses.replace(
        alone, disturbance=Disturbance(
            input=Sinusoid([3.0], 5.0), output=Sinusoid([0.0, 0.0], 9.0),
            state=Steps([0.25], [[0.0, 0.0], [0.0, -1.0]]),
        ),
    )  # fmt: skip
    with torch.no_grad():
        both = mt.rollout(loop(), mt.Scenario.stack([alone, twice]))
        for i, given in enumerate((alone, twice)):
            assert torch.equal(mt.rollout(loop(), given).plant.x, both.plant.x[:, i])
    assert not torch.equal(both.plant.x[:, 0], both.plant.x[:, 1])
