"""Every plant keeps its contract, and `check_plant` refuses what does not."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.domains import Positive
from mann_torch.errors import DomainError, InterfaceError, KindError, ShapeError
from mann_torch.plants import (
    ELZEBDA,
    PLANTS,
    CartPole,
    DoubleIntegrator,
    Field,
    FlexibleJointArm,
    LinearPlant,
    NLinkArm,
    Pendulum,
    PlanarQuadrotor,
    Plant,
    Regression,
    RohrsPlant,
    SlotineLiArm,
    TwoLinkArm,
    WingRock,
)
from mann_torch.stiff import FirstOrderBlock
from mann_torch.testing import check_plant
from mann_torch.types import Channel, PlantState

TWO_BY_TWO = ([[0.0, 1.0], [-2.0, -3.0]], [[0.0, 1.0], [1.0, 0.5]], [[1.0, 0.0]])
#: A new plant is one line here.
PLANTS_TO_CHECK: dict[str, Callable[[], Plant]] = {
    "two_link_arm": TwoLinkArm,
    "n_link_arm": NLinkArm,
    "n_link_arm of one": lambda: NLinkArm(1),
    "n_link_arm of five": lambda: NLinkArm(5),
    "flexible_joint_arm": FlexibleJointArm,
    "flexible_joint_arm, links seen": lambda: FlexibleJointArm(3, measured="links"),
    "flexible_joint_arm, all seen": lambda: FlexibleJointArm(1, measured="all"),
    "slotine_li_arm": SlotineLiArm,
    "wing_rock": WingRock,
    "wing_rock, accelerometer": lambda: WingRock(accelerometer=True),
    "planar_quadrotor": PlanarQuadrotor,
    "linear": lambda: LinearPlant(*TWO_BY_TWO),
    "linear, state seen": lambda: LinearPlant(*TWO_BY_TWO, measured="state"),
    "regression": Regression,
    "rohrs": RohrsPlant,
    "rohrs, slow": lambda: RohrsPlant(fast_poles=False),
    "cart_pole": CartPole,
    "cart_pole, position": lambda: CartPole("position"),
    "cart_pole, angle": lambda: CartPole("angle"),
    "pendulum": Pendulum,
    "double_integrator": lambda: DoubleIntegrator(2),
}
#: Parameters with what the defaults leave out.
OTHER_PARAMETERS: dict[str, dict[str, Any]] = {
    "two_link_arm": {"viscous": [0.3, 0.2], "coulomb": [0.1, 0.2]},
    "n_link_arm": {
        "masses": [1.0, 2.0, 0.5],
        "lengths": [0.4, 0.7, 1.0],
        "centers": [0.5, 0.3, 0.6],
        "inertias": [0.1, 0.2, 0.05],
        "viscous": [0.3, 0.2, 0.1],
        "coulomb": [0.1, 0.2, 0.3],
    },
    "flexible_joint_arm": {"viscous": [0.3, 0.2], "motor_friction": [0.5, 0.4]},
    "wing_rock": {"weights": ELZEBDA},
    "cart_pole": {"inertia": [0.1], "cart_friction": [0.2], "pole_friction": [0.1]},
    "regression": {"theta": [-1.0, 0.5], "frequency": [2.0], "decay": [0.3]},
    "pendulum": {"inertia": [0.1], "viscous": [0.2], "coulomb": [0.3]},
}


@pytest.mark.parametrize("name", PLANTS_TO_CHECK)
def test_a_plant_of_the_library_keeps_its_contract(name: str) -> None:
    check_plant(PLANTS_TO_CHECK[name]())


@pytest.mark.parametrize("name", OTHER_PARAMETERS)
def test_it_does_with_other_parameters(name: str) -> None:
    plant = PLANTS_TO_CHECK[name]()
    check_plant(plant, plant.parameters_of(**OTHER_PARAMETERS[name]))


def test_the_list_has_every_plant_there_is() -> None:
    assert set(PLANTS) <= set(PLANTS_TO_CHECK)
    for name, kind in PLANTS.items():
        assert type(PLANTS_TO_CHECK[name]()) is kind


class Box(NamedTuple):
    level: Tensor  # (..., 1)


class Tank(NamedTuple):
    area: Tensor  # (..., 1)


AREA = {"area": Field((2.0,), Positive(), "m^2")}


class Good(Plant):
    """A tank that drains: the plant that the others break."""

    Parameters = Tank
    fields = AREA
    inputs = (Channel("flow", "m^3/s"),)
    outputs = (Channel("level", "m"),)

    def rest(self):
        return Box(torch.ones(1, dtype=torch.float64))

    def output(self, state, coefficients):
        return state.level

    def derivative(self, t, state, input, disturbance, coefficients):
        return Box((input.u - torch.tanh(state.level)) / coefficients.area)


def changed(base: type = Good, **members: Any) -> Plant:
    return type("Broken", (base,), members)()


def other_derivative(compute: Callable[..., Tensor]) -> Plant:
    """The tank with another rate, of (self, state, input, area)."""

    def derivative(self, t, state, input, disturbance, coefficients):
        return Box(compute(self, state.level, input.u, coefficients.area))

    return changed(derivative=derivative)


def counted(self: Any, level: Tensor, u: Tensor, area: Tensor) -> Tensor:
    self.calls = getattr(self, "calls", 0) + 1
    return (u - level) / area + 1e-6 * self.calls


def written(self: Any, level: Tensor, u: Tensor, area: Tensor) -> Tensor:
    level.add_(1.0)
    return (u - level) / area


def decided(self: Any, level: Tensor, u: Tensor, area: Tensor) -> Tensor:
    return u / area if bool((level > 100.0).any()) else (u - level) / area


def blocked(t, state, input, disturbance, coefficients, gains):
    rate = Good().derivative(t, state, input, disturbance, coefficients)
    return rate, FirstOrderBlock(torch.zeros(3, 3).double(), torch.zeros(3).double())


def slipped(t, state, input, disturbance, coefficients, gains):
    rate = Good().derivative(t, state, input, disturbance, coefficients)
    return Box(rate.level + 1e-3), None


def _kept(plant: Plant) -> Plant:
    plant.drain = torch.tensor([0.3], dtype=torch.float64)
    return plant


BROKEN: dict[str, tuple[Callable[[], Plant], str]] = {
    "channels that are strings": (lambda: changed(inputs=("flow",)), "inputs.*Channel"),
    "no outputs": (lambda: changed(outputs=()), "outputs are empty"),
    "a name twice": (
        lambda: changed(outputs=(Channel("y", "m"), Channel("y", "m"))),
        "outputs have a name twice",
    ),
    "parameters that are a dict": (lambda: changed(Parameters=dict), "Parameters is no NamedTuple"),
    "fields that differ": (lambda: changed(fields={}), "Parameters has .*same names"),
    "a field that is a number": (lambda: changed(fields={"area": 2.0}), "area.*no Field"),
    "a state that is a tensor": (
        lambda: changed(rest=lambda self: torch.ones(1).double()),
        r"rest\(\) is no NamedTuple",
    ),
    "a state of float32": (
        lambda: changed(rest=lambda self: Box(torch.ones(1))),
        r"rest\(\).*float32.*float64",
    ),
    "a rate of float32": (
        lambda: other_derivative(lambda self, level, u, area: (u - level).float()),
        "derivative is torch.float32",
    ),
    "a rate of another width": (
        lambda: other_derivative(lambda self, level, u, area: torch.cat([u, level], dim=-1)),
        r"derivative of 8 samples has shape \(8, 2\)",
    ),
    "a rate of another kind": (
        lambda: changed(derivative=lambda self, t, state, *_: Tank(state.level)),
        "derivative gives a Tank, the state is a Box",
    ),
    "a rate that fails on batches": (
        lambda: other_derivative(lambda self, level, u, area: u @ level),
        "derivative of a batch of states fails; RuntimeError",
    ),
    "an output of another width": (
        lambda: changed(output=lambda self, state, c: state.level[..., 0]),
        "output of 8 samples has shape",
    ),
    "a measurement that is a tensor": (
        lambda: changed(measure=lambda self, state, c: state.level),
        "measure gives no NamedTuple",
    ),
    "coefficients in a dict": (
        lambda: changed(coefficients=lambda self, p: {"area": p.area}),
        "coefficients are no NamedTuple",
    ),
    "a root of the negative": (
        lambda: other_derivative(lambda self, level, u, area: torch.sqrt(level - 2.0)),
        "derivative is not finite",
    ),
    "random numbers": (
        lambda: other_derivative(lambda self, level, u, area: u - level + torch.randn_like(u)),
        "other numbers for the same arguments",
    ),
    "something kept": (lambda: other_derivative(counted), "other numbers for the same arguments"),
    "writing into the state": (lambda: other_derivative(written), "writes into its arguments"),
    "samples that mix": (
        lambda: other_derivative(lambda self, level, u, area: u - level.mean(0, keepdim=True)),
        "sample 0 of a batch has another derivative",
    ),
    "a batch of one dimension only": (
        lambda: other_derivative(
            lambda self, level, u, area: (
                u - level.sum(dim=1, keepdim=True) if level.dim() > 1 else u - level
            )
        ),
        "batch",
    ),
    "a decision in Python": (lambda: other_derivative(decided), "vmap.*torch.where"),
    "a decision for each": (
        lambda: other_derivative(lambda self, level, u, area: u if level > 1.0 else u - level),
        r"a decision on data.*take torch.where.* in Broken, test_plant_contract.py:\d+: ",
    ),
    "a number taken out": (
        lambda: other_derivative(lambda self, level, u, area: u - level.item()),
        r"a decision on data.*take torch.where.* in Broken, test_plant_contract.py:\d+: ",
    ),
    "a number of one sample taken out": (
        lambda: other_derivative(
            lambda self, level, u, area: u - (level if level.numel() > 1 else level.item())
        ),
        r"vmap fails; a decision on data|single sample fails; a decision on data",
    ),
    "a float32 literal": (
        lambda: other_derivative(lambda self, level, u, area: torch.tensor(0.1) * (u - level)),
        r"0.1 is 0.10000000149.* in float32; give dtype=torch.float64.*test_plant_contract.py:",
    ),
    "a tensor that nobody knows of": (
        lambda: _kept(other_derivative(lambda self, level, u, area: u - self.drain * level)),
        "drain is a tensor that is not registered",
    ),
    "a state detached": (
        lambda: other_derivative(lambda self, level, u, area: (u - level.detach()) / area),
        "gradient of the derivative by field 0 of the state.*detach",
    ),
    "an input detached": (
        lambda: other_derivative(lambda self, level, u, area: (u.detach() - level) / area),
        "gradient of the derivative by the input",
    ),
    "a parameter detached": (
        lambda: other_derivative(lambda self, level, u, area: (u - level) / area.detach()),
        "gradient of the derivative by area",
    ),
    "a root at rest": (
        lambda: other_derivative(
            lambda self, level, u, area: (
                u - torch.where(level == 1.0, level, torch.sqrt((level - 1.0).abs()))
            )
        ),
        "gradient by the state is not finite at rest",
    ),
    "another rate where it is linearized": (
        lambda: changed(linearized=lambda self, *given: slipped(*given)),
        "linearized with a held input gives another derivative",
    ),
    "a block that does not fit": (
        lambda: changed(linearized=lambda self, *given: blocked(*given)),
        r"jacobian of the stiff block has shape \(3, 3\)",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_plant_is_refused_by_what_is_wrong(name: str) -> None:
    make, said = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"(?s)Broken, contract line \d: .*{said}"):
        check_plant(make())


def test_the_plant_that_they_break_is_right() -> None:
    check_plant(Good())


def test_a_literal_that_float64_holds_as_it_is_passes() -> None:
    check_plant(other_derivative(lambda self, level, u, area: torch.tensor(0.5) * (u - level)))


def test_a_plant_without_parameters_is_refused_when_it_is_made() -> None:
    members = {name: value for name, value in vars(Good).items() if name != "Parameters"}
    with pytest.raises(InterfaceError, match=r"Tankless lacks Parameters \(Parameters: NamedTuple"):
        type("Tankless", (Plant,), members)()


def test_a_plant_that_was_never_set_up_is_refused() -> None:
    plant = changed(__init__=lambda self: None)
    for use in (check_plant, lambda plant: mt.ClosedLoop(plant, mt.LinearFeedback([[1.0]]))):
        with pytest.raises(InterfaceError, match=r"__init__ does not call super\(\).__init__\(\)"):
            use(plant)


RUNS: dict[str, tuple[Callable[[], Plant], type[Exception], str]] = {
    "a row too few": (
        lambda: other_derivative(lambda self, level, u, area: (u - level)[..., 0]),
        InterfaceError,
        r"Broken: the derivative is not of the state's form: plant.level has shape \(\), not",
    ),
    "a rate too wide": (
        lambda: other_derivative(lambda self, level, u, area: torch.cat([u, level], dim=-1)),
        InterfaceError,
        r"plant.level has shape \(2,\), not \(1,\)",
    ),
    "another kind": (
        lambda: changed(derivative=lambda self, t, state, *_: Tank(state.level)),
        InterfaceError,
        "plant is a Tank, not a Box",
    ),
    "a start in float32": (
        lambda: changed(rest=lambda self: Box(torch.ones(1))),
        mt.errors.DtypeError,
        "the state of Broken, level, is torch.float32",
    ),
}


@pytest.mark.parametrize("engine", ["auto", "torch"])
@pytest.mark.parametrize("name", RUNS)
def test_a_rollout_refuses_it_by_name(
    name: str, engine: str, caplog: pytest.LogCaptureFixture
) -> None:
    make, kind, said = RUNS[name]
    plant = make()
    loop = mt.ClosedLoop(plant, mt.LinearFeedback([[1.0]]))
    scenario = mt.Scenario(mt.Sinusoid([0.3]), plant.parameters_of(), horizon=0.1)
    with pytest.raises(kind, match=said):
        mt.rollout(loop, scenario, engine=engine)
    assert all(record.levelno < logging.WARNING for record in caplog.records)  # torch's stack


class FastArm(TwoLinkArm):
    def coriolis(self, q, qd, coefficients):
        return 1.1 * super().coriolis(q, qd, coefficients)


class TurnedArm(TwoLinkArm):
    """C' in place of C, which is as skew."""

    def coriolis(self, q, qd, coefficients):
        return super().coriolis(q, qd, coefficients).mT


class LopsidedArm(TwoLinkArm):
    def mass_matrix(self, q, coefficients):
        M = super().mass_matrix(q, coefficients)
        return M + torch.tensor([[0.0, 0.1], [0.0, 0.0]], dtype=torch.float64)


class LightArm(TwoLinkArm):
    def mass_matrix(self, q, coefficients):
        return super().mass_matrix(q, coefficients) - 10.0 * torch.eye(2, dtype=torch.float64)


class DrivenArm(TwoLinkArm):
    def load(self, q, qd, coefficients):
        return super().load(q, qd, coefficients) - 0.1 * qd


class WeightlessArm(TwoLinkArm):
    def energy(self, state, coefficients):
        return self.kinetic_energy(state, coefficients)


class MisreadArm(SlotineLiArm):
    def regressor(self, q, qd, v, a):
        return super().regressor(q, qd, qd, a)


class PushedCart(CartPole):
    def input_matrix(self, q, coefficients):
        return None


class FlatArm(TwoLinkArm):
    def energy(self, state, coefficients):
        return super().energy(state, coefficients).unsqueeze(-1)


class FirstOrderArm(TwoLinkArm):
    def rest(self):
        return PlantState(torch.zeros(3).double(), torch.zeros(3).double())


class FarSeeingArm(TwoLinkArm):
    sensing = (1, 2)


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        (FarSeeingArm, r"sensing = \(1, 2\)"),
        (FastArm, "dM/dt - 2 C is not skew"),
        (TurnedArm, "C qd is not what Lagrange"),
        (LopsidedArm, "mass_matrix is not symmetric"),
        (LightArm, "mass_matrix is not positive definite"),
        (DrivenArm, ".*energy grows faster"),
        (WeightlessArm, ".*energy grows faster"),
        (MisreadArm, "no theta gives"),
        (PushedCart, r"1 inputs meet an input_matrix \(2, 2\)"),
        (FlatArm, r"energy has shape \(8, 1\)"),
        (FirstOrderArm, r"rest.* no PlantState of n_joints = 2"),
    ],
)
def test_broken_physics_is_refused_by_what_is_wrong(plant: type[Plant], said: str) -> None:
    with pytest.raises(InterfaceError, match=rf"contract line \d of a MechanicalPlant: {said}"):
        check_plant(plant())


def test_arguments_that_are_none_are_named() -> None:
    with pytest.raises(KindError, match="plant"):
        check_plant("two_link_arm")  # type: ignore[arg-type]
    bad = Tank(torch.tensor([-1.0], dtype=torch.float64))
    with pytest.raises(DomainError, match="area"):
        check_plant(Good(), bad)
    with pytest.raises(KindError, match="states"):
        check_plant(Good(), states=[1.0])
    with pytest.raises(ShapeError, match="states"):
        check_plant(Good(), states=Box(torch.ones(8, 2, dtype=torch.float64)))


def test_states_of_a_caller_are_those_that_are_tried() -> None:
    rooted = other_derivative(lambda self, level, u, area: (u - torch.sqrt(level)) / area)
    with pytest.raises(InterfaceError, match="states"):
        check_plant(rooted)  # random levels are below 0
    levels = torch.linspace(0.5, 2.0, 8, dtype=torch.float64).unsqueeze(-1)
    check_plant(rooted, states=Box(levels))
