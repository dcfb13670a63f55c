"""Controllers in MuJoCo: they meet the plant of a rollout there, and any other model by names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.control import LinearFeedback
from mann_torch.deployment import SATURATED
from mann_torch.plants import CartPole, DoubleIntegrator, WingRock
from mann_torch.signals import Polynomial, Sinusoid, Steps
from mann_torch.simulators import MujocoModel, Payload, arm_mjcf, arm_payloads, run_in_mujoco
from tests.conftest import generator, make_controller, make_scenario

mujoco = pytest.importorskip("mujoco", reason="an extra: pip install mann_torch[simulators]")

JOINTS, MOTORS = ["joint_1", "joint_2"], ["torque_1", "torque_2"]


def force(u: float, period: float, **other: Any) -> mt.Stepper:
    """Commands u [N] at each tick, whatever it sees: u times a reference of 1."""
    feedback = LinearFeedback([[0.0, 0.0]], [[u]])
    return mt.deploy(feedback, period, plant=DoubleIntegrator(), engine="torch", **other)


def papers() -> tuple[mt.MannController, Any]:
    """The paper's controller: N = 10, 5 slots."""
    memory = mt.WorkingMemory(5, 10, mt.ReallocatingAttention("initial"))
    controller = mt.MannController(2, 10, memory)
    return controller, controller.initial_weights((), generator())


@pytest.mark.parametrize("motors", [MOTORS, None])
def test_a_controller_meets_the_arm_of_a_rollout(motors: Any) -> None:
    controller, weights = papers()
    scenario = make_scenario(0.25, (0.1, 0.2))
    with torch.no_grad():
        loop = mt.ClosedLoop(mt.TwoLinkArm(), controller, clock=mt.Clock(1e-3))
        ours = mt.rollout(loop, scenario, weights=weights)
    text = arm_mjcf(mt.TwoLinkArm(), scenario.parameters, integrator="RK4")
    payloads = arm_payloads(mt.TwoLinkArm(), scenario)
    run = run_in_mujoco(
        mt.deploy(controller, 1e-3), text, JOINTS, scenario.reference, 0.25,
        actuators=motors, payloads=payloads, weights=weights,
    )  # fmt: skip
    assert run.stopped_at is None and len(run.t) == 251 and len(run.u) == 250
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
        mt.deploy(controller, 1e-3),
        arm_mjcf(mt.TwoLinkArm(), scenario.parameters, integrator=integrator),
        JOINTS, scenario.reference, 20.0, actuators=MOTORS,
        payloads=arm_payloads(mt.TwoLinkArm(), scenario), weights=weights,
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
    text, one = SLIDE.format(mass=1), Polynomial([[1.0]])
    loads = [Payload(0.75, "crate", 4.0), Payload(0.25, "crate", 2.0)]
    run = run_in_mujoco(force(2.0, period), text, ["rail"], one, 1.0, payloads=loads)
    assert float(run.qd[-1]) == pytest.approx(2.0 * (0.25 + 0.5 / 2 + 0.25 / 4), rel=1e-12)
    moved = [Payload(0.252, "crate", 2.0)]
    run = run_in_mujoco(force(2.0, period), text, ["rail"], one, 1.0, payloads=moved)
    assert float(run.qd[-1]) == pytest.approx(2.0 * (0.252 + 0.748 / 2), rel=1e-12)


def test_a_motor_has_a_gear_and_a_controller_its_flags() -> None:
    text, one = SLIDE.format(mass=1), Polynomial([[1.0]])
    limited = force(2.0, 1e-3, actuator=mt.Actuator(1, limit=1.5))
    run = run_in_mujoco(limited, text, ["rail"], one, 1.0, actuators=["rope"])
    assert float(run.qd[-1]) == pytest.approx(4.0 * 1.5, rel=1e-12)
    assert run.flags.tolist() == [SATURATED] * 1000
    torch.testing.assert_close(run.error, 1.0 - run.q)


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
    scenario = mt.Scenario(Sinusoid([0.2], 1.0), plant.parameters_of(), 1.0, start=start)
    loop = mt.ClosedLoop(plant, feedback, clock=mt.Clock(0.004))
    with torch.no_grad():
        ours = mt.rollout(loop, scenario, mt.RungeKutta(1e-3), motion_dt=0.004)
    deployed, path = mt.deploy(loop), tmp_path / "cart.xml"
    path.write_text(CART)
    run = run_in_mujoco(
        deployed, path, ["track", "pivot"], scenario.reference, 1.0,
        actuators=["push"], start=tuple(start),
    )  # fmt: skip
    assert 0.01 < float(ours.plant.q[:, 1].abs().max()) < 0.5
    torch.testing.assert_close(run.q, ours.plant.q, rtol=0, atol=1e-10)
    torch.testing.assert_close(run.error, ours.error, rtol=0, atol=1e-10)
    # The joints the other way round are measured the other way round, and it falls.
    fallen = run_in_mujoco(
        deployed, path, ["pivot", "track"], scenario.reference, 1.0,
        actuators=["push"], start=(q.flip(0), [0.0, 0.0]),
    )  # fmt: skip
    assert torch.equal(fallen.q[0], q.flip(0)) and float(fallen.q[:, 0].abs().max()) > 1.0


def test_it_goes_on_from_a_state_and_may_be_frozen() -> None:
    scenario = make_scenario(0.2)
    text, weights = arm_mjcf(mt.TwoLinkArm(), scenario.parameters), papers()[1]
    deployed = mt.deploy(papers()[0], 1e-3, engine="torch")

    def run(horizon: float, **given: Any) -> Any:
        return run_in_mujoco(deployed, text, JOINTS, scenario.reference, horizon, **given)

    again, first = run(0.05, weights=weights), run(0.05, weights=weights)
    assert deployed.to_bytes(again.state) == deployed.to_bytes(first.state)
    learned = run(0.05, state=first.state)
    frozen = run(0.05, state=first.state, adapt=False)
    before, after, still = (
        deployed.unpacked(x.state).controller.network.W for x in (first, learned, frozen)
    )
    assert torch.equal(before, still) and not torch.equal(before, after)
    with pytest.raises(mt.ConfigError, match="weights beside a state"):
        run(0.05, weights=weights, state=first.state)


def test_what_does_not_fit_is_named(tmp_path: Path) -> None:
    text = arm_mjcf(mt.TwoLinkArm())
    arm = mt.deploy(make_controller("nn"), 1e-3, engine="torch")

    def of(period: float) -> mt.Stepper:
        return mt.deploy(make_controller("nn"), period, engine="torch")

    def refused(said: str, kind: type[Exception] = mt.ConfigError, **changed: Any) -> None:
        given = {
            "stepper": arm, "model": text, "joints": JOINTS,
            "reference": Sinusoid([1.0, 0.0], 0.5), "horizon": 0.01, **changed,
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
        stepper=of(1.5e-3),
    )
    refused("period = 0.0005 s: must be a whole", stepper=of(5e-4))
    refused("is below the period", horizon=1e-4)
    refused("joints: 1 of them, the controller measures 2", mt.ShapeError, joints=["joint_1"])
    refused("gives 2 inputs, the model takes 1", mt.ShapeError, actuators=["torque_2"])
    refused(r"reference has 1 numbers .* 2 and none", mt.ShapeError, reference=Polynomial([[1.0]]))
    refused("asks for 2 derivatives .* Steps has 0", reference=Steps([1.0], [[1.0, 0.0]] * 2))
    feedback = LinearFeedback([[1.0, 1.0]], [[1.0]])
    rolling = mt.deploy(feedback, 1e-3, plant=WingRock(), engine="torch")
    refused("the controller measures roll.*: not positions and rates of joints", stepper=rolling)
    refused("start has shapes", mt.ShapeError, start=([0.0], [0.0, 0.0]))
    refused("MuJoCo says: .*Error opening file", model=str(tmp_path / "nothing.xml"))
    refused("MuJoCo says: XML parse error", model="<mujoco><body></mujoco>")
    refused("stepper = 3: must be a Stepper", stepper=3)
    refused("model = 3: must be an MjModel", model=3)
    free = "<body><freejoint name='f'/><geom size='1'/></body>"
    free = f"<mujoco><worldbody>{free}</worldbody></mujoco>"
    refused("joint 'f' is neither a hinge nor a slide", model=free, joints=["f"])


def test_a_run_ends_where_its_numbers_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs there
    one, text = Polynomial([[1.0]]), SLIDE.format(mass=0.5)
    run = run_in_mujoco(force(1e308, 1e-3), text, ["rail"], one, 0.1)
    assert run.stopped_at == pytest.approx(1e-3) and len(run.t) == 2
    # Finite, but MuJoCo would leave out the control of a motor from here on.
    run = run_in_mujoco(force(1e11, 1e-3), text, ["rail"], one, 0.1, actuators=["rope"])
    assert run.stopped_at == pytest.approx(1e-3)
    run = run_in_mujoco(force(1e9, 1e-3), text, ["rail"], one, 0.1)
    assert run.stopped_at is None
