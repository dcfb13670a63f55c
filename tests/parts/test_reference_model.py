"""Reference models against closed forms."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import Polynomial, Steps
from mann_torch.simulation import observe
from tests.conftest import make_controller
from tests.parts.linear import loop, scenario

CONSTANT = Polynomial([[2.0]])


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_a_first_order_model_is_an_exponential_and_errors_are_its_own(engine: str) -> None:
    made = loop(model=mt.LinearModel.first_order(3.0, 1.5, start=0.5))
    given = scenario(reference=CONSTANT)
    with torch.no_grad():
        run = mt.rollout(made, given, mt.RungeKutta(1e-3), engine=engine)
        shown = observe(made, given, run)
    wanted = 3.0 + (0.5 - 3.0) * torch.exp(-3.0 * run.t)
    torch.testing.assert_close(run.reference.value[:, 0], wanted, rtol=0, atol=1e-11)
    assert torch.equal(run.reference.command, torch.full_like(run.output, 2.0))
    assert torch.equal(run.error, run.reference.value - run.output)
    square = run.error[:-1, 0].square() * run.t.diff()
    torch.testing.assert_close(run.squared_error[-2, 0], square.sum(), rtol=1e-9, atol=0)
    torch.testing.assert_close(
        shown.reference.rate[:, 0], 3.0 * (3.0 - shown.reference.value[:, 0]), rtol=0, atol=1e-12
    )


def test_a_gain_of_0_opens_the_model() -> None:
    given = scenario(reference=CONSTANT)
    with torch.no_grad():
        runs = [
            mt.rollout(loop(model=mt.LinearModel([[-3.0]], [[3.0]], observer_gain=gain)), given)
            for gain in (None, [[0.0]], [[20.0]])
        ]
    assert torch.equal(runs[0].followed, runs[1].followed)
    # Pulled to the plant, which lags behind: the error is smaller.
    assert float(mt.srmse(runs[2])) < 0.5 * float(mt.srmse(runs[0]))


def test_a_second_order_model_lets_a_controller_follow_steps() -> None:
    """Critically damped: 1 - (1 + w t) exp(-w t) from the step on; the arm follows."""
    model = mt.SecondOrderModel(2, 8.0)
    steps = Steps([0.25], [[0.0, 0.0], [0.5, -0.3]])
    made = mt.ClosedLoop(mt.TwoLinkArm(), make_controller("nn"), model=model)
    given = mt.Scenario(steps, mt.arm_parameters(), 2.0)
    with pytest.raises(mt.errors.ConfigError, match="derivatives of its reference"):
        mt.rollout(mt.ClosedLoop(mt.TwoLinkArm(), make_controller("nn")), given)
    with torch.no_grad():
        run = mt.rollout(made, given, mt.Implicit(1e-3))
    s = (8.0 * (run.t - 0.25)).clamp(min=0.0)
    wanted = (1.0 - (1.0 + s) * torch.exp(-s)).unsqueeze(-1) * torch.tensor([0.5, -0.3]).double()
    torch.testing.assert_close(run.reference.value, wanted, rtol=0, atol=2e-5)
    assert bool((run.t == 0.25).any()) and float(run.error[-1].abs().max()) < 0.03


def test_what_is_no_model_is_refused() -> None:
    with pytest.raises(mt.errors.DomainError, match="start"):
        mt.LinearModel.first_order(1.0, start=float("nan"))
    with pytest.raises(mt.errors.KindError, match="rate"):
        mt.LinearModel.first_order("fast")  # type: ignore[arg-type]
