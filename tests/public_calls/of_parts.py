"""Calls of controllers, plants and signals."""

from __future__ import annotations

import torch

import mann_torch as mt
from mann_torch import control, plants, signals
from mann_torch.constraints import Positive
from mann_torch.functional import as_float64
from tests.conftest import generator, make_controller
from tests.public_calls.things import CONTROLLER, LOOP, NOISE, SCENARIO, Call

NUMBERS = dict.fromkeys(("write_gain", "rate_W", "error_gain"), 2.0)

CALLS: dict[str, Call] = {
    "MannController": (
        mt.MannController,
        {
            "n_joints": 2,
            "n_hidden": 6,
            "memory": mt.WorkingMemory(4, 6, mt.HardAttention()),
            "error_gain": 5.0,
            "base_gain": 20.0,
            "robust_gain": 10.0,
            "weight_bound": 0.0,
            "rate_W": 10.0,
            "rate_V": 10.0,
            "e_modification": 0.0,
            "initial_std": 0.1,
            "network": None,
            "inputs": None,
            "readouts": control.Readouts(2),
        },
    ),
    "AdaptiveNetwork": (
        control.AdaptiveNetwork,
        {
            "n_inputs": 10,
            "n_hidden": 6,
            "n_outputs": 2,
            "rate_W": 10.0,
            "rate_V": 10.0,
            "e_modification": 0.0,
            "initial_std": 0.1,
            "law_W": None,
            "law_V": None,
        },
    ),
    "FilteredTracking": (control.FilteredTracking, {"n_joints": 2, "error_gain": 5.0}),
    "RobustGain": (
        control.RobustGain,
        {"base_gain": 20.0, "robust_gain": 10.0, "weight_bound": 0.0},
    ),
    "equal_parameter_hidden": (
        mt.equal_parameter_hidden,
        {"n_inputs": 10, "n_outputs": 2, "n_hidden": 10, "n_slots": 5},
    ),
    "Controller.initial_weights": (
        CONTROLLER.initial_weights,
        {"batch_shape": (2,), "generator": generator()},
    ),
    "DesignModule.initialize": (CONTROLLER.initialize, NUMBERS),
    "DesignModule.tune": (lambda names: CONTROLLER.tune(names), {"names": "rate_W"}),
    "DesignModule.share": (
        make_controller("nn").share,
        {"name": "rate_W", "tensor": torch.ones((), dtype=torch.float64)},
    ),
    "DesignModule.declare": (
        make_controller("nn").declare,
        {"name": "own", "value": 1.0, "domain": Positive(), "event_shape": ()},
    ),
    "TwoLinkArm": (mt.TwoLinkArm, {"gravity": 9.8, "coulomb_velocity": 0.01}),
    "TwoLinkArm.check": (LOOP.plant.check, {"parameters": mt.arm_parameters()}),
    "arm_parameters": (
        plants.arm_parameters,
        dict.fromkeys(("masses", "lengths", "viscous", "coulomb"), (1.0, 1.0)),
    ),
    "Sinusoid": (mt.Sinusoid, {"amplitude": [1.0, 1.0], "frequency": 0.5, "offset": 0.0}),
    "PiecewiseConstant": (mt.PiecewiseConstant, {"times": [1.0], "values": [[1.0], [2.0]]}),
    "PiecewiseConstant.stack": (
        mt.PiecewiseConstant.stack,
        {"schedules": [SCENARIO.schedule["masses"]]},
    ),
    "MeasurementNoise": (
        mt.MeasurementNoise,
        {"std": [0.1, 0.1], "seed": 0, "rate": 100.0},
    ),
    "MeasurementNoise.stack": (mt.MeasurementNoise.stack, {"noises": [NOISE]}),
    "growing_square": (signals.growing_square, {"initial": [1.0], "increment": 0.2, "jumps": 3}),
    "as_float64": (lambda value: as_float64(value), {"value": 1.0}),
}
