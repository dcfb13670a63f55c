"""Calls of plants, and of the check of one's own."""

from __future__ import annotations

from mann_torch import plants
from mann_torch.testing import check_plant
from tests.public_calls.things import Call

GRAVITY = {"gravity": 9.8}
ARM = {**GRAVITY, "coulomb_velocity": 0.01}
SECOND_ORDER = {"numerator": [1.0], "denominator": [1.0, 2.0, 1.0]}

CALLS: dict[str, Call] = {
    "NLinkArm": (plants.NLinkArm, {"n_joints": 3, **ARM}),
    "FlexibleJointArm": (plants.FlexibleJointArm, {"n_links": 2, **ARM, "measured": "motors"}),
    "CartPole": (plants.CartPole, {"followed": "both", **GRAVITY}),
    "Pendulum": (plants.Pendulum, ARM),
    "DoubleIntegrator": (plants.DoubleIntegrator, {"n_joints": 2}),
    "LinearPlant": (
        plants.LinearPlant,
        {"A": [[-1.0]], "B": [[0.5]], "C": [[1.0]], "measured": "state"},
    ),
    "LinearPlant.from_transfer_function": (
        plants.LinearPlant.from_transfer_function,
        {**SECOND_ORDER, "measured": "output"},
    ),
    "channels": (plants.channels, {"prefix": "q", "count": 2, "unit": "rad"}),
    "zeros": (lambda widths: plants.zeros(widths), {"widths": 2}),
    "controllable_form": (plants.controllable_form, SECOND_ORDER),
    "RohrsPlant": (plants.RohrsPlant, {"fast_poles": True}),
    "WingRock": (plants.WingRock, {"accelerometer": True}),
    "lumped": (
        plants.lumped,
        {
            "mass": 1.0,
            "length": 1.0,
            "center": 0.5,
            "inertia": 0.12,
            "load_mass": 2.0,
            "load_center": 0.6,
            "load_inertia": 0.25,
            "load_angle": 0.5,
        },
    ),
    "check_plant": (
        check_plant,
        {
            "plant": plants.DoubleIntegrator(),
            "parameters": plants.DoubleIntegrator().parameters_of(masses=[2.0]),
            "states": plants.DoubleIntegrator().rest(),
        },
    ),
}
