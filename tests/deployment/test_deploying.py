"""What can be deployed, and what is refused by name."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch import control, parts, plants
from mann_torch.errors import ConfigError, KindError, ShapeError
from tests.conftest import make_controller, make_loop

MODEL, INPUT = [[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]]
STATE = plants.LinearPlant(MODEL, INPUT, [[1.0, 0.0]], "state")


def numbers(*given: float) -> torch.Tensor:
    return torch.tensor(given, dtype=torch.float64)


def test_a_loop_brings_its_parts() -> None:
    loop = mt.ClosedLoop(
        mt.TwoLinkArm(),
        make_controller("nn"),
        actuator=parts.Actuator(2, limit=30.0, lag=0.01),
        clock=mt.Clock(2e-3),
        model=parts.SecondOrderModel(2, 5.0),
    )
    stepper = mt.deploy(loop, engine="torch")
    assert stepper.period == 2e-3
    assert [name for name, _ in stepper.ports.reference] == ["q_1", "q_2"]
    assert stepper.ports.measurement[0] == ("q_1", "rad")
    assert stepper.tick.model is loop.model and stepper.tick.actuator is loop.actuator


def test_a_controller_of_joints_needs_no_plant() -> None:
    ports = mt.deploy(make_controller("nn"), 1e-3, engine="torch").ports
    assert ports.reference[2] == ("q_1 rate", "rad/s") and ports.order == 2
    assert [unit for _, unit in ports.input] == ["N m", "N m"]


def test_another_says_that_it_needs_one() -> None:
    feedback = control.LinearFeedback([[3.0, 2.0]], [[3.0]])
    with pytest.raises(ConfigError, match=r"LinearFeedback .*give deploy a plant"):
        mt.deploy(feedback, 1e-3)
    stepper = mt.deploy(feedback, 1e-3, plant=STATE, engine="torch")
    row = numbers(0.5), numbers(0.1, 0.2)
    u, _ = stepper(stepper.initial_state(*row), *row)
    assert float(u) == pytest.approx(3.0 * 0.5 - 3.0 * 0.1 - 2.0 * 0.2, rel=1e-12)


def test_a_model_moves_as_its_equations_say() -> None:
    """y'' = 9 (1 - y) - 6 y' from rest: 1 - (1 + 3 t) e^-3t, to the square of the period."""
    model = parts.SecondOrderModel(2, 3.0)
    errors = []
    for period in (4e-3, 2e-3):
        stepper = mt.deploy(make_controller("nn"), period, model=model, engine="torch")
        row = torch.ones(2).double(), torch.zeros(4).double()
        state = stepper.initial_state(*row)
        for _ in range(round(0.4 / period) + 1):
            _, state = stepper(state, *row)
        kept = stepper.unpacked(state).model
        assert kept is not None
        t = torch.tensor(0.4).double()
        errors.append(float((kept[0] - 1.0 + (1.0 + 3.0 * t) * torch.exp(-3.0 * t)).abs()))
    assert errors[0] < 1e-4 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def refused(match: str, kind: type[Exception] = ConfigError, **given: object) -> None:
    arguments = {"controller": make_controller("nn"), "period": 1e-3, **given}
    with pytest.raises(kind, match=match):
        mt.deploy(**arguments)  # type: ignore[arg-type]


def test_bad_settings_are_named() -> None:
    refused("give a period", period=None)
    refused("period", period=-1.0)
    refused("period", period=float("nan"))
    refused("dtype", dtype=torch.float16)
    refused("engine", engine="warp")
    refused("controller", KindError, controller=mt.TwoLinkArm())
    refused("actuator of 3", ShapeError, actuator=parts.Actuator(3, limit=1.0))
    refused("reference model of 1", ShapeError, model=parts.SecondOrderModel(1, 3.0))
    refused("the loop's", controller=make_loop("nn"), plant=mt.TwoLinkArm())


def test_a_clock_that_is_another_is_refused() -> None:
    loop = mt.ClosedLoop(mt.TwoLinkArm(), make_controller("nn"), clock=mt.Clock(2e-3))
    refused(r"the loop's clock has 0.002 s", controller=loop, period=1e-3)
    line = mt.ClosedLoop(mt.TwoLinkArm(), make_controller("nn"), clock=mt.Clock(2e-3, hold="first"))
    refused("holds on a line", controller=line, period=None)


def test_a_controller_that_samples_between_ticks_is_refused() -> None:
    sampled = control.L1Adaptive(MODEL, INPUT, period=0.01)
    refused(r"samples every 0.01 s", controller=sampled, plant=STATE, period=3e-3)
    refused(r"float32 loses", controller=sampled, plant=STATE, period=1e-3, dtype=torch.float32)
    mt.deploy(sampled, 2e-3, plant=STATE, engine="torch")


def test_weights_that_are_not_finite_are_refused() -> None:
    controller = make_controller("nn")
    controller.network.initial_V.fill_(torch.inf)
    refused("initial V", controller=controller)


def test_constants_of_a_batch_are_refused() -> None:
    controller = make_controller("nn")
    controller.initialize(base_gain=torch.tensor([10.0, 20.0]).double())
    refused(r"batch shape \(2,\)", ShapeError, controller=controller)


def test_outputs_that_are_not_measured_can_not_be_followed() -> None:
    class Blind(plants.LinearPlant):
        def measure(self, state, coefficients):  # type: ignore[no-untyped-def]
            return type(state)(*(2.0 * x for x in state))

    plant = Blind(MODEL, INPUT, [[1.0, 0.0]], "state")
    network = control.LinearNetwork(control.Identity(3), 1)
    mrac = control.Mrac.of_model(MODEL, INPUT, network)
    refused(
        "not among what is measured", controller=mrac, plant=plant,
        model=parts.LinearModel(MODEL, INPUT, [[1.0, 0.0]]),
    )  # fmt: skip
