"""Every controller keeps its contract, and `check_controller` refuses what does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control, parts, plants
from mann_torch.constraints import NonNegative
from mann_torch.errors import ConfigError, InterfaceError, KindError, ShapeError
from mann_torch.testing import check_controller
from mann_torch.types import ControlOutput
from tests.conftest import CONTROLLERS, make_controller
from tests.contracts.broken_controllers import BROKEN, Good, of_two, other_input


def of_paper(name: str) -> Callable[[], control.Controller]:
    return lambda: make_controller(name)


MODEL, INPUT = [[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]]


def of_mrac(**parts: Any) -> control.Mrac:
    """Of a mass on a line."""
    network = control.LinearNetwork(control.Identity(3), 1)
    return control.Mrac.of_model(
        MODEL, INPUT, network, feedback=[[1.0, 2.0]], feedforward=[[1.0]], **parts
    )


ARM, SLOTINE_LI = plants.TwoLinkArm(), plants.SlotineLiArm()
EXTRAS = {"robust": control.BoundaryLayer(0.5, 0.2), "integral": control.IntegralAction(0.3)}


def meta_adaptive(attention: Any = None, nominal: bool = False, **parts: Any) -> Any:
    """Of layers on what two joints measure, with a memory of two slots."""
    network = control.LinearNetwork(control.Layers.random(4, 6), 2)
    memory = None if attention is None else mt.WorkingMemory(2, 6, attention)
    known = {"mechanics": ARM, "parameters": ARM.parameters_of()} if nominal else {}
    return control.MetaAdaptive(network, memory=memory, **known, **parts)


def with_readouts(memory: Any = None) -> mt.MannController:
    """Of small gains: else squared torques are so large that differences are of rounding."""
    readouts = control.Readouts(3, recall_time=0.1)
    return mt.MannController(2, 6, memory, base_gain=1.0, robust_gain=0.1, readouts=readouts)


#: A new controller is one line here.
CONTROLLERS_TO_CHECK: dict[str, Callable[[], control.Controller]] = {
    **{f"mann, {name}": of_paper(name) for name in CONTROLLERS},
    "mann, kappa > 0": lambda: mt.MannController(2, 6, e_modification=0.1),
    "mann, radial basis": lambda: mt.MannController(
        2, network=control.LinearNetwork(control.RadialBasis.scattered(10, 6, 3.0), 2)
    ),
    "mann, readouts": with_readouts,
    "mann, readouts and a memory": lambda: with_readouts(
        mt.WorkingMemory(2, 6, mt.HardAttention())
    ),
    "linear_feedback": lambda: control.LinearFeedback([[3.0, 2.0]], [[3.0]], 0.5),
    "linear_feedback, two inputs": lambda: control.LinearFeedback(
        [[3.0, 0.0, 2.0, 0.0], [0.0, 3.0, 0.0, 2.0]]
    ),
    "mrac": of_mrac,
    "mrac, of parts": lambda: of_mrac(
        error_feedback=[[0.5, 0.5]],
        robust=control.BoundaryLayer(0.5, 0.2),
        integral=control.IntegralAction(0.3),
        saturation=control.MuModification(MODEL, INPUT, 0.5, 1.0, 0.1),
        labels=control.FilteredLabels([[0.0, 1.0], [0.0, 0.0]], INPUT, 5.0),
    ),
    "mrac, readouts": lambda: of_mrac(
        labels=control.FilteredLabels([[0.0, 1.0], [0.0, 0.0]], INPUT, 5.0),
        readouts=control.Readouts(2),
    ),
    "mrac, hedged": lambda: of_mrac(saturation=control.Hedging(MODEL, INPUT, 0.5)),
    "mrac, known limits": lambda: of_mrac(saturation=control.KnownLimits(0.5)),
    "mrac, augmented error": lambda: of_mrac(saturation=control.AugmentedError(MODEL, INPUT, 0.5)),
    "mrac, with a memory": lambda: of_mrac(memory=mt.WorkingMemory(2, 3, mt.HardAttention())),
    "estimator": control.Estimator,
    "estimator, of pairs": lambda: control.Estimator(
        control.AdaptiveLaw(control.LeastSquares(2.0), control.ConcurrentLearning(0.3, 2, 0.02))
    ),
    "estimator, drem": lambda: control.Estimator(control.Drem(2.0, 0.95), start=0.5),
    "output_mrac": lambda: control.OutputMrac([1.0, 2.0]),
    "pid": lambda: control.Pid(2, 20.0, 5.0, 3.0, 0.1),
    "pid, filtered": lambda: control.Pid(1, 3.0, 1.0, 0.5, filter_rate=20.0, limit=0.8),
    "pid, of the output": lambda: control.Pid(2, 20.0, 5.0, 3.0, derivative_of="output"),
    "computed_torque": lambda: control.ComputedTorque(ARM, ARM.parameters_of()),
    "computed_torque, of parts": lambda: control.ComputedTorque(
        ARM, ARM.parameters_of(), [20.0, 30.0], **EXTRAS
    ),
    "slotine_li": lambda: control.SlotineLi(SLOTINE_LI),
    "slotine_li, of parts": lambda: control.SlotineLi(
        SLOTINE_LI,
        control.AdaptiveLaw(control.SigmaModification(0.1), control.Projection(5.0)),
        start=[3.0, 1.0, 1.0, 0.5],
        **EXTRAS,
    ),
    "meta_adaptive": meta_adaptive,
    "meta_adaptive, nominal": lambda: meta_adaptive(nominal=True, drive_gain=[2.0, 3.0], **EXTRAS),
    "meta_adaptive, hard": lambda: meta_adaptive(mt.HardAttention(), nominal=True),
    "meta_adaptive, reallocating": lambda: meta_adaptive(mt.ReallocatingAttention()),
    "l1": lambda: control.L1Adaptive(MODEL, INPUT),
    "l1, piecewise constant": lambda: control.L1Adaptive(MODEL, INPUT, period=0.01),
    "output_mrac, without filters": lambda: control.OutputMrac(robust=control.BoundaryLayer()),
}


@pytest.mark.parametrize("name", CONTROLLERS_TO_CHECK)
def test_a_controller_of_the_library_keeps_its_contract(name: str) -> None:
    check_controller(CONTROLLERS_TO_CHECK[name](), engine="torch")


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS_TO_CHECK)
def test_it_does_on_the_compiled_engine(name: str) -> None:
    check_controller(CONTROLLERS_TO_CHECK[name](), engine="compiled")


def test_the_list_has_every_controller_there_is() -> None:
    kinds = {type(make()) for make in CONTROLLERS_TO_CHECK.values()}
    assert set(control.CONTROLLERS.values()) <= kinds


def test_plant_and_reference_may_be_given() -> None:
    gains = [[0.0, 3.0, 0.0, 2.0]]
    feedback = control.LinearFeedback(gains)
    with pytest.raises(ConfigError, match=r"fits none of the plants .*feedback of 7 numbers"):
        check_controller(control.LinearFeedback([[1.0] * 7]), engine="torch")
    check_controller(feedback, plants.CartPole("position"), mt.Sinusoid([0.3]), engine="torch")
    check_controller(make_controller("nn"), mt.TwoLinkArm(), mt.Sinusoid([0.3, 0.2], 0.2))


class Gains(NamedTuple):
    command: Tensor  # (..., 1)


class Adaptive(control.Controller):
    """u = k r, dk/dt = gamma r e: it needs the command that its model is told to follow."""

    def __init__(self, gamma: float | list[float] = 1.0) -> None:
        super().__init__()
        self.gamma: Tensor
        self.declare("gamma", gamma, NonNegative())

    def initial_state(self, reference, measurement, batch_shape, generator=None, weights=None):
        return Gains(torch.zeros(*batch_shape, 1, dtype=torch.float64)), None

    def forward(self, reference, measurement, state, mode):
        error = reference.value - measurement.y
        rates = Gains(self.gamma.unsqueeze(-1) * reference.command * error)
        return ControlOutput(state.command * reference.command, rates, None)


def test_one_that_needs_a_command_follows_a_model() -> None:
    check_controller(Adaptive(), engine="torch")
    plant = plants.LinearPlant([[-1.0]], [[0.5]], [[1.0]])
    check_controller(Adaptive(), plant, engine="torch")
    model = parts.LinearModel.first_order(2.0)
    check_controller(Adaptive(), plant, mt.Sinusoid([1.0]), model, engine="torch")
    with pytest.raises(ShapeError, match="model of width 2"):
        check_controller(Adaptive(), plant, model=parts.SecondOrderModel(2, 1.0))
    with pytest.raises(ShapeError, match=r"batch shape \(2,\).* one value of each"):
        check_controller(Adaptive([1.0, 2.0]))


def test_what_does_not_fit_is_named() -> None:
    nn = make_controller("nn")
    with pytest.raises(KindError, match="controller = 3"):
        check_controller(3)  # type: ignore[arg-type]
    with pytest.raises(ShapeError, match="1 inputs and 1 outputs"):
        check_controller(nn, plants.Pendulum())
    with pytest.raises(ShapeError, match="feedback of 3 numbers"):
        check_controller(control.LinearFeedback([[1.0, 2.0, 3.0]]), plants.Pendulum())
    with pytest.raises(ShapeError, match="reference of width 3"):
        check_controller(nn, reference=mt.Sinusoid([1.0, 1.0, 1.0]))
    with pytest.raises(ConfigError, match="fits none of the plants"):
        check_controller(control.LinearFeedback(torch.zeros(5, 5, dtype=torch.float64)))


def test_the_good_one_passes() -> None:
    check_controller(Good())


def test_engines_that_disagree_are_told_of() -> None:
    check_controller(other_input(of_two), engine="torch")
    with pytest.raises(InterfaceError, match="compiled, it gives other numbers than in torch"):
        check_controller(other_input(of_two), engine="compiled")


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_controller_is_refused_by_what_is_wrong(name: str) -> None:
    make, told = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"^\w+, contract .*(?:{told})"):
        check_controller(make(), engine="torch")
