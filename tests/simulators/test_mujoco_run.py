"""Controllers in MuJoCo: they meet the plant of a rollout there, and any other model by names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import LinearFeedback
from mann_torch.plants import CartPole
from mann_torch.signals import Sinusoid
from mann_torch.simulators import MujocoModel, Payload, arm_mjcf, arm_payloads, run_in_mujoco
from tests.conftest import generator, make_controller, make_scenario
from tests.simulators.ticking import Ticking

mujoco = pytest.importorskip("mujoco", reason="an extra: pip install mann_torch[simulators]")

JOINTS, MOTORS = ["joint_1", "joint_2"], ["torque_1", "torque_2"]


class Constant:
    """Gives the same input at each tick."""

    def __init__(self, u: list[float], period: float) -> None:
        self.u, self.period, self.seen = torch.tensor(u, dtype=torch.float64), period, []

    def initial_state(self, reference: Any, measurement: Any) -> int:
        return 0

    def step(self, state: int, reference: Any, measurement: Any) -> tuple[Tensor, int, int]:
        self.seen.append(measurement)
        return self.u, state + 1, state % 3


def papers() -> tuple[mt.MannController, Any]:
    """The paper's controller: N = 10, 5 slots."""
    memory = mt.WorkingMemory(5, 10, mt.ReallocatingAttention("initial"))
    controller = mt.MannController(2, 10, memory)
    return controller, controller.initial_weights((), generator())


@pytest.mark.parametrize("motors", [MOTORS, None])
def test_a_controller_meets_the_arm_of_a_rollout(motors: Any) -> None:
    controller, weights = papers()
    scenario = make_scenario(0.4, (0.15, 0.3))
    with torch.no_grad():
        loop = mt.ClosedLoop(mt.TwoLinkArm(), controller, clock=mt.Clock(1e-3))
        ours = mt.rollout(loop, scenario, weights=weights)
    text = arm_mjcf(mt.TwoLinkArm(), scenario.parameters, integrator="RK4")
    payloads = arm_payloads(mt.TwoLinkArm(), scenario)
    run = run_in_mujoco(
        Ticking(controller, 1e-3, weights), text, JOINTS, scenario.reference, 0.4,
        actuators=motors, payloads=payloads,
    )  # fmt: skip
    assert run.stopped_at is None and len(run.t) == 401 and len(run.u) == 400
    torch.testing.assert_close(run.t, ours.t, rtol=0, atol=1e-12)
    assert float(ours.error.abs().max()) > 0.05
    # Within a period of 1 ms both solvers are of order 2 at least.
    torch.testing.assert_close(run.q, ours.plant.q, rtol=0, atol=2e-5)
    torch.testing.assert_close(run.srmse, mt.srmse(ours), rtol=1e-4, atol=0)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "within"), [("implicitfast", 0.02), ("RK4", 1e-4)])
def test_twenty_seconds_with_a_payload_that_changes(integrator: str, within: float) -> None:
    """The paper's illustration: masses double at 10 s; lengths 1 and 2 m."""
    controller, weights = papers()
    masses = torch.tensor([[0.8, 2.3], [1.6, 4.6]], dtype=torch.float64)
    scenario = mt.Scenario(
        Sinusoid([1.0, 0.0], 0.5),
        mt.arm_parameters(lengths=[1.0, 2.0]),
        20.0,
        schedule={"masses": mt.PiecewiseConstant([10.0], masses)},
    )
    with torch.no_grad():
        loop = mt.ClosedLoop(mt.TwoLinkArm(), controller, clock=mt.Clock(1e-3))
        ours = mt.srmse(mt.rollout(loop, scenario, weights=weights))
    run = run_in_mujoco(
        Ticking(controller, 1e-3, weights),
        arm_mjcf(mt.TwoLinkArm(), scenario.parameters, integrator=integrator),
        JOINTS, scenario.reference, 20.0, actuators=MOTORS,
        payloads=arm_payloads(mt.TwoLinkArm(), scenario),
    )  # fmt: skip
    print(f"{integrator}: {(run.srmse / ours - 1.0).tolist()}")
    torch.testing.assert_close(run.srmse, ours, rtol=within, atol=0)


SLIDE = """<mujoco><option gravity="0 0 0" timestep="0.001" integrator="implicitfast"/><worldbody>
<body name="crate"><joint name="rail" type="slide" axis="1 0 0"/>
<geom type="box" size="1 1 1" mass="{mass}" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor name="rope" joint="rail" gear="4"/></actuator></mujoco>"""


@pytest.mark.parametrize("period", [1e-3, 4e-3])
def test_a_payload_counts_from_its_time_on(period: float) -> None:
    """Of a constant force, also where the mass changes within a period of the controller."""
    constant = Constant([2.0], period)
    loads = [Payload(0.75, "crate", 4.0), Payload(0.25, "crate", 2.0)]
    reference = Sinusoid([1.0], 1.0)
    run = run_in_mujoco(constant, SLIDE.format(mass=1), ["rail"], reference, 1.0, payloads=loads)
    assert float(run.qd[-1]) == pytest.approx(2.0 * (0.25 + 0.5 / 2 + 0.25 / 4), rel=1e-12)
    moved = [Payload(0.25 + 2e-3, "crate", 2.0)]
    run = run_in_mujoco(constant, SLIDE.format(mass=1), ["rail"], reference, 1.0, payloads=moved)
    assert float(run.qd[-1]) == pytest.approx(2.0 * (0.252 + 0.748 / 2), rel=1e-12)
    # A motor has a gear; flags are the controller's.
    run = run_in_mujoco(
        constant, SLIDE.format(mass=1), ["rail"], reference, 1.0, actuators=["rope"]
    )
    assert float(run.qd[-1]) == pytest.approx(8.0, rel=1e-12)
    assert run.flags[:5].tolist() == [0, 1, 2, 0, 1]
    torch.testing.assert_close(run.error[:, 0], torch.sin(run.t) - run.q[:, 0])


def test_a_payload_scales_the_inertia_unless_it_says_one() -> None:
    model = mujoco.MjModel.from_xml_string(SLIDE.format(mass=3))
    world = MujocoModel(model, ["rail"])
    world.begin([0.3], [0.1])
    before = world.model.body_inertia[1].copy()
    world.load(Payload(0.0, "crate", 6.0))
    np.testing.assert_allclose(world.model.body_inertia[1], 2.0 * before, rtol=1e-14)
    world.load(Payload(0.0, "crate", 6.0, (1.0, 2.0, 3.0)))
    np.testing.assert_allclose(world.model.body_inertia[1], [1.0, 2.0, 3.0], rtol=0)
    assert float(world.data.qpos[0]) == 0.3 and float(world.model.body_subtreemass[0]) == 6.0
    assert float(model.body_mass[1]) == 3.0  # what was given is as it was


CART = """<mujoco><option gravity="0 0 -9.81" timestep="0.001" integrator="RK4"/><worldbody>
<body name="floor"/><body name="cart"><joint name="track" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="pole"><joint name="pivot" type="hinge" axis="0 1 0"/>
<inertial pos="0 0 0.5" mass="0.1" diaginertia="1e-12 1e-12 1e-12"/></body></body></worldbody>
<actuator><motor name="unused" joint="pivot"/><motor name="push" joint="track"/></actuator>
</mujoco>"""


def test_a_model_file_of_ones_own(tmp_path: Path) -> None:
    """Cart and pole, read from a file, with one motor: as our plant under the same feedback."""
    plant = CartPole("position", gravity=9.81)
    feedback = LinearFeedback([[-3.0, -40.0, -5.0, -8.0]], [[-3.0]])
    q = torch.tensor([0.1, 0.05], dtype=torch.float64)
    start = mt.PlantState(q, torch.zeros(2, dtype=torch.float64))
    scenario = mt.Scenario(Sinusoid([0.2], 1.0), plant.parameters_of(), 2.0, start=start)
    loop = mt.ClosedLoop(plant, feedback, clock=mt.Clock(0.004))
    with torch.no_grad():
        ours = mt.rollout(loop, scenario, mt.RungeKutta(1e-3), motion_dt=0.004)
    path = tmp_path / "cart.xml"
    path.write_text(CART)
    run = run_in_mujoco(
        Ticking(feedback, 0.004), path, ["track", "pivot"], scenario.reference, 2.0,
        actuators=["push"], start=tuple(start),
    )  # fmt: skip
    assert 0.01 < float(ours.plant.q[:, 1].abs().max()) < 0.5
    torch.testing.assert_close(run.q, ours.plant.q, rtol=0, atol=1e-10)
    torch.testing.assert_close(run.error, ours.error, rtol=0, atol=1e-10)
    # The joints the other way round are measured the other way round, and it falls.
    fallen = run_in_mujoco(
        Ticking(feedback, 0.004), path, ["pivot", "track"], scenario.reference, 2.0,
        actuators=["push"], start=(q.flip(0), [0.0, 0.0]),
    )  # fmt: skip
    assert torch.equal(fallen.q[0], q.flip(0)) and float(fallen.q[:, 0].abs().max()) > 1.0


def test_what_does_not_fit_is_named(tmp_path: Path) -> None:
    text = arm_mjcf(mt.TwoLinkArm())
    constant, reference = Constant([0.0, 0.0], 1e-3), Sinusoid([1.0, 0.0], 0.5)

    def refused(said: str, kind: type[Exception] = mt.ConfigError, **changed: Any) -> None:
        given = {
            "stepper": constant, "model": text, "joints": JOINTS, "reference": reference,
            "horizon": 0.01, **changed,
        }  # fmt: skip
        with pytest.raises(kind, match=said) as caught:
            run_in_mujoco(**given)
        assert "\n" not in str(caught.value)

    refused("no joint 'elbow' in the model; it has joint_1, joint_2", joints=["joint_1", "elbow"])
    refused("no actuator 'rope' in the model; it has torque_1, torque_2", actuators=["rope"])
    refused("no body 'hand' in the model; it has link_1", payloads=[Payload(0.0, "hand", 1.0)])
    refused("payload .* must be >= 0", payloads=[Payload(-1.0, "link_1", 1.0)])
    refused("a name is there twice", joints=["joint_1", "joint_1"])
    refused("at least one name", joints=[])
    refused(
        "period = 0.0015 s: must be a whole multiple of the model's timestep, 0.001 s",
        stepper=Constant([0.0, 0.0], 1.5e-3),
    )
    refused("period = 0.0005 s: must be a whole", stepper=Constant([0.0, 0.0], 5e-4))
    refused("is below the period", horizon=1e-4)
    refused("reference has 2 numbers .* 1 joints", mt.ShapeError, joints=["joint_1"])
    refused(r"inputs \(2,\): the model takes \(1,\)", mt.ShapeError, actuators=["torque_2"])
    refused("start has", mt.ShapeError, start=([0.0], [0.0, 0.0]))
    refused("MuJoCo says: .*Error opening file", model=str(tmp_path / "nothing.xml"))
    refused("MuJoCo says: XML parse error", model="<mujoco><body></mujoco>")
    refused("a deployed controller", stepper=3)
    refused("model = 3: must be an MjModel", model=3)
    free = "<body><freejoint name='f'/><geom size='1'/></body>"
    free = f"<mujoco><worldbody>{free}</worldbody></mujoco>"
    refused("joint 'f' is neither a hinge nor a slide", model=free, joints=["f"])


def test_a_run_ends_where_its_numbers_do() -> None:
    run = run_in_mujoco(
        Constant([float("nan"), 0.0], 1e-3), arm_mjcf(mt.TwoLinkArm()), JOINTS,
        Sinusoid([1.0, 0.0], 0.5), 0.1,
    )  # fmt: skip
    assert run.stopped_at == pytest.approx(1e-3) and len(run.t) == 2


def test_weights_matter() -> None:
    """What is compared above is a controller that adapts."""
    controller = make_controller("nn")
    scenario = make_scenario(0.2)
    text = arm_mjcf(mt.TwoLinkArm(), scenario.parameters)
    runs = []
    for i in range(2):
        ticking = Ticking(controller, 1e-3, controller.initial_weights((), generator(i)))
        runs.append(run_in_mujoco(ticking, text, JOINTS, scenario.reference, 0.2))
    assert float((runs[0].u - runs[1].u).abs().max()) > 1e-3
