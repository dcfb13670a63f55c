"""Actuators against closed forms; a short lag under a stiff loop."""

from __future__ import annotations

import itertools

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import LinearFeedback
from mann_torch.simulation import observe
from tests.conftest import generator, make_controller, make_scenario
from tests.parts.linear import PLANT, scenario


def applied(actuator: mt.Actuator, command: float, engine: str, dt: float) -> tuple[Tensor, Tensor]:
    """What becomes of a constant command, at times [s]."""
    loop = mt.ClosedLoop(PLANT, LinearFeedback([[0.0, 0.0]], offset=command), actuator=actuator)
    with torch.no_grad():
        run = mt.rollout(loop, scenario(0.5), mt.RungeKutta(dt), engine=engine, sample_dt=0.05)
        shown = observe(loop, scenario(0.5), run)
    assert torch.equal(shown.input, torch.full_like(shown.input, command))
    return run.sample_t, shown.applied[:, 0]


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_a_lag_is_an_exponential_and_its_rate_limit_a_ramp(engine: str) -> None:
    t, a = applied(mt.Actuator(1, lag=0.1, lower=-1.0, upper=2.0), 5.0, engine, 1e-3)
    torch.testing.assert_close(a, 2.0 * (1.0 - torch.exp(-t / 0.1)), rtol=0, atol=1e-9)
    _, a = applied(mt.Actuator(1, lag=0.1, rate_limit=3.0), -5.0, engine, 1e-3)
    torch.testing.assert_close(a, -3.0 * t, rtol=0, atol=1e-12)


@pytest.mark.parametrize("command,wanted", [(5.0, 2.0), (-5.0, -1.0), (0.5, 0.5)])
def test_limits_need_not_be_alike(command: float, wanted: float) -> None:
    _, a = applied(mt.Actuator(1, lower=-1.0, upper=2.0), command, "torch", 0.01)
    assert torch.equal(a, torch.full_like(a, wanted))


@pytest.mark.parametrize("lag", [1e-5, 1e-3])
def test_a_short_lag_leaves_the_papers_loop_stable_at_the_default_step(lag: float) -> None:
    """An explicit lag would diverge for h > 2 lag; the errors fall as the step's square."""
    actuator = mt.Actuator(2, lag=lag)
    loop = mt.ClosedLoop(mt.TwoLinkArm(), make_controller("soft"), actuator=actuator)
    with torch.no_grad():
        runs = [
            mt.rollout(loop, make_scenario(1.0, (0.3,)), mt.Implicit(dt), generator=generator())
            for dt in (4e-3, 2.5e-4)
        ]
    coarse, fine = (mt.srmse(run) for run in runs)
    assert runs[0].status.item() == 0
    torch.testing.assert_close(coarse, fine, rtol=3e-3, atol=0)


def test_a_lag_keeps_the_implicit_method_of_order_2() -> None:
    """Against Runge-Kutta at small steps."""
    parts = {"actuator": mt.Actuator(1, lag=0.05)}
    loop = mt.ClosedLoop(PLANT, LinearFeedback([[4.0, 3.0]], [[4.0]]), **parts)
    with torch.no_grad():
        known = mt.rollout(loop, scenario(1.0), mt.RungeKutta(1e-3)).plant.x[-1]
        errors = [
            float((mt.rollout(loop, scenario(1.0), mt.Implicit(dt)).plant.x[-1] - known).norm())
            for dt in (0.02, 0.01, 0.005)
        ]
    assert errors[0] < 1e-3
    assert all(3.3 < a / b < 4.7 for a, b in itertools.pairwise(errors)), errors


def test_constants_slopes_are_those_of_differences() -> None:
    """On both engines; limits, lag and rate limit are all met on the way."""
    names = ("upper", "lower", "lag", "rate_limit")

    def loss(engine: str, **values: float) -> tuple[Tensor, list[Tensor]]:
        given = {"upper": 0.9, "lower": -0.7, "lag": 0.05, "rate_limit": 8.0, **values}
        loop = mt.ClosedLoop(
            PLANT, LinearFeedback([[40.0, 8.0]], [[40.0]]), actuator=mt.Actuator(1, **given)
        )
        loop.tune(*names)
        free = [loop.constant(name) for name in names]
        run = mt.rollout(loop, scenario(3.0), mt.RungeKutta(2e-3), engine=engine)
        return mt.srmse(run).sum(), free

    slopes = [torch.stack(torch.autograd.grad(*loss(engine))) for engine in ("torch", "compiled")]
    torch.testing.assert_close(slopes[0], slopes[1], rtol=1e-10, atol=1e-14)
    assert float(slopes[0].abs().min()) > 0
    base = {"upper": 0.9, "lower": -0.7, "lag": 0.05}
    for name, slope in zip(base, slopes[0][:, 0].tolist(), strict=False):
        ends = [loss("compiled", **{name: base[name] + s * 1e-5})[0].item() for s in (1, -1)]
        assert abs(slope - (ends[0] - ends[1]) / 2e-5) <= 2e-3 * abs(slope), name


def test_limits_that_crossed_since_are_refused() -> None:
    actuator = mt.Actuator(1, limit=1.0)
    with torch.no_grad():
        actuator.lower.fill_(2.0)
    loop = mt.ClosedLoop(PLANT, LinearFeedback([[4.0, 3.0]]), actuator=actuator)
    with pytest.raises(mt.errors.DomainError, match="above upper"):
        mt.rollout(loop, scenario())
