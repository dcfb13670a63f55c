"""Calls of what runs plants and controllers in other people's simulators."""

from __future__ import annotations

from typing import Any

from gymnasium.vector import AutoresetMode

import mann_torch as mt
from mann_torch.control import LinearFeedback
from mann_torch.plants import DoubleIntegrator
from mann_torch.simulators import (
    MujocoModel,
    Payload,
    PlantEnv,
    PlantVectorEnv,
    arm_mjcf,
    arm_payloads,
    as_policy,
    run_episode,
    run_in_mujoco,
)
from mann_torch.simulators.world import squared_error
from tests.conftest import make_controller, make_scenario
from tests.public_calls.things import SOLVER, Call

MASS = DoubleIntegrator()
TASK = mt.Scenario(mt.Sinusoid([1.0], 0.5), MASS.parameters_of(), 0.02)
WORLD: dict[str, Any] = {
    "plant": MASS,
    "scenario": TASK,
    "period": 0.01,
    "actuator": mt.Actuator(1, 1.0),
    "sensor": mt.Sensor(0.1),
    "model": mt.SecondOrderModel(1, 5.0),
    "hold": "zero",
    "solver": SOLVER,
    "reward": squared_error,
    "reference_order": 1,
    "divergence_limit": 10.0,
    "engine": "torch",
}
SIDE_BY_SIDE = {"num_envs": 2, **WORLD, "autoreset_mode": AutoresetMode.SAME_STEP}
ENV = PlantEnv(MASS, TASK, engine="torch")
PUSHING = mt.deploy(LinearFeedback([[1.0, 1.0]], [[1.0]]), 0.01, plant=MASS, engine="torch")
ARM, ARMS_TASK = mt.TwoLinkArm(), make_scenario(0.02, (0.01,))
TEXT, JOINTS, MOTORS = arm_mjcf(ARM), ["joint_1", "joint_2"], ["torque_1", "torque_2"]

CALLS: dict[str, Call] = {
    "PlantEnv": (PlantEnv, WORLD),
    "PlantVectorEnv": (PlantVectorEnv, SIDE_BY_SIDE),
    "as_policy": (
        as_policy,
        {
            "stepper": PUSHING,
            "env": ENV,
            "state": None,
            "weights": None,
            "adapt": True,
        },
    ),
    "run_episode": (
        run_episode,
        {"env": ENV, "policy": lambda seen, state: ([0.0], state), "seed": 0},
    ),
    "arm_mjcf": (
        arm_mjcf,
        {
            "plant": ARM,
            "parameters": mt.arm_parameters(),
            "timestep": 1e-3,
            "integrator": "RK4",
        },
    ),
    "arm_payloads": (arm_payloads, {"plant": ARM, "scenario": ARMS_TASK}),
    "MujocoModel": (MujocoModel, {"model": TEXT, "joints": JOINTS, "actuators": MOTORS}),
    "run_in_mujoco": (
        run_in_mujoco,
        {
            "stepper": mt.deploy(make_controller("nn"), 0.001, engine="torch"),
            "model": TEXT,
            "joints": JOINTS,
            "reference": ARMS_TASK.reference,
            "horizon": 0.002,
            "actuators": MOTORS,
            "payloads": [Payload(0.001, "link_2", 1.0)],
            "start": ([0.0, 0.0], [0.0, 0.0]),
            "state": None,
            "weights": make_controller("nn").initial_weights(()),
            "adapt": True,
        },
    ),
}
