"""Calls of controllers of mechanical plants, and of L1."""

from __future__ import annotations

import mann_torch as mt
from mann_torch import control, plants
from tests.public_calls.things import Call

ARM = plants.TwoLinkArm()
LAW = control.AdaptiveLaw(control.ConstantGain(2.0))
EXTRAS = {"robust": control.BoundaryLayer(), "integral": control.IntegralAction()}
NOMINAL = {"mechanics": ARM, "parameters": ARM.parameters_of()}
MODEL, INPUT = [[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]]

CALLS: dict[str, Call] = {
    "BoxProjection": (control.BoxProjection, {"bound": 2.0, "margin": 0.1}),
    "ComputedTorque": (
        control.ComputedTorque,
        {**NOMINAL, "proportional": 25.0, "derivative": [10.0, 8.0], **EXTRAS},
    ),
    "L1Adaptive": (
        lambda A_m, B, law=None, bandwidth=30.0, command_gain=1.0, Q=1.0: control.L1Adaptive(
            A_m, B, law, None, bandwidth, command_gain, Q
        ),
        {"A_m": MODEL, "B": INPUT, "law": LAW, "bandwidth": 30.0, "command_gain": 1.0, "Q": 1.0},
    ),
    "L1Adaptive of a period": (
        lambda period=None: control.L1Adaptive(MODEL, INPUT, period=period),
        {"period": 0.01},
    ),
    "MetaAdaptive": (
        control.MetaAdaptive,
        {
            "network": control.LinearNetwork(control.Identity(4), 2),
            **NOMINAL,
            "memory": mt.WorkingMemory(2, 4, mt.HardAttention()),
            "inputs": control.Measured(4),
            "error_gain": 1.0,
            "feedback": 10.0,
            "drive_gain": [1.0, 2.0],
            **EXTRAS,
        },
    ),
    "Pid": (
        control.Pid,
        {
            "n_outputs": 1,
            "proportional": 3.0,
            "integral": 1.0,
            "derivative": 0.5,
            "offset": 0.0,
            "filter_rate": 20.0,
            "limit": 2.0,
            "unwinding_rate": 5.0,
            "derivative_of": "output",
        },
    ),
    "SlotineLi": (
        control.SlotineLi,
        {
            "mechanics": plants.SlotineLiArm(),
            "law": LAW,
            "error_gain": 5.0,
            "feedback": 20.0,
            "start": 0.0,
            **EXTRAS,
        },
    ),
    "l1_gain": (control.l1_gain, {"A_m": MODEL, "B": INPUT, "bandwidth": 30.0}),
    "l1_norm": (control.l1_norm, {"A": MODEL, "B": INPUT, "C": [[1.0, 0.0]]}),
}
