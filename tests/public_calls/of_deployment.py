"""Calls of deployment."""

from __future__ import annotations

import tempfile

import torch

import mann_torch as mt
from mann_torch import parts
from tests.public_calls.things import CONTROLLER, Call

STEPPER = mt.deploy(CONTROLLER, 1e-3, engine="torch")
REFERENCE, MEASUREMENT = (torch.zeros(n, dtype=torch.float64) for n in (6, 4))
STATE = STEPPER.initial_state(REFERENCE, MEASUREMENT)
STEP = {"state": STATE, "reference": REFERENCE, "measurement": MEASUREMENT, "adapt": True}

ROOM = tempfile.TemporaryDirectory()  # while the tests run

CALLS: dict[str, Call] = {
    "deploy": (
        mt.deploy,
        {
            "controller": CONTROLLER,
            "period": 1e-3,
            "plant": mt.TwoLinkArm(),
            "model": parts.SecondOrderModel(2, 3.0),
            "actuator": parts.Actuator(2, limit=10.0),
            "dtype": torch.float64,
            "engine": "torch",
        },
    ),
    "Stepper.initial_state": (
        STEPPER.initial_state,
        {
            "reference": REFERENCE,
            "measurement": MEASUREMENT,
            "generator": torch.Generator().manual_seed(0),
            "weights": None,
        },
    ),
    "Stepper.__call__": (STEPPER, STEP),
    "Stepper.step": (STEPPER.step, STEP),
    "Stepper.packed": (STEPPER.packed, {"kept": STEPPER.unpacked(STATE)}),
    "Stepper.unpacked": (STEPPER.unpacked, {"state": STATE}),
    "Stepper.to_bytes": (STEPPER.to_bytes, {"state": STATE}),
    "Stepper.from_bytes": (STEPPER.from_bytes, {"data": STEPPER.to_bytes(STATE)}),
    "Stepper.to_c": (
        STEPPER.to_c,
        {"folder": f"{ROOM.name}/out", "name": "controller", "constants": "baked", "libm": True},
    ),
}
