"""Calls of laws, networks and feedback."""

from __future__ import annotations

import mann_torch as mt
from mann_torch import control, plants, testing
from tests.public_calls.things import Call

LAW = control.GradientLaw(2.0)
SIZES = {"n_inputs": 10, "n_hidden": 6, "n_outputs": 2}
NETWORK = control.RadialBasisNetwork.scattered(**SIZES)

CALLS: dict[str, Call] = {
    "MannController of a network": (
        lambda network=None, inputs=None: mt.MannController(2, network=network, inputs=inputs),
        {
            "network": NETWORK,
            "inputs": control.ErrorsAndReference(2),
        },
    ),
    "ErrorsAndReference": (control.ErrorsAndReference, {"n_joints": 2}),
    "GradientLaw": (control.GradientLaw, {"adaptation_rate": 2.0}),
    "LinearFeedback": (
        control.LinearFeedback,
        {"feedback": [[1.0, 2.0]], "feedforward": [[1.0]], "offset": 0.5},
    ),
    "check_controller": (
        testing.check_controller,
        {
            "controller": control.LinearFeedback([[1.0, 2.0]]),
            "plant": plants.DoubleIntegrator(),
            "reference": mt.Sinusoid([1.0]),
            "model": mt.SecondOrderModel(1, 3.0),
            "engine": "torch",
        },
    ),
    "check_law": (testing.check_law, {"law": LAW}),
    "check_network": (testing.check_network, {"network": NETWORK}),
    "RadialBasisNetwork": (
        control.RadialBasisNetwork,
        {"centers": [[0.0, 1.0], [1.0, 0.0]], "n_outputs": 1, "width": 0.5, "law": LAW},
    ),
    "RadialBasisNetwork.scattered": (
        control.RadialBasisNetwork.scattered,
        {**SIZES, "width": 0.5, "law": LAW, "seed": 1},
    ),
}
