"""Calls of laws, networks and feedback."""

from __future__ import annotations

import torch

import mann_torch as mt
from mann_torch import control, plants, testing
from tests.public_calls.things import Call

ROW = torch.zeros(2, dtype=torch.float64)
LAW = control.AdaptiveLaw(control.ConstantGain(2.0))
BASIS = control.RadialBasis.scattered(10, 6)
NETWORK = control.LinearNetwork(BASIS, 2)
MEMORY = mt.WorkingMemory(3, 6, mt.HardAttention())

CALLS: dict[str, Call] = {
    "MannController of a network": (
        lambda network=None, inputs=None, readouts=None: mt.MannController(
            2, network=network, inputs=inputs, readouts=readouts
        ),
        {
            "network": NETWORK,
            "inputs": control.ErrorsAndReference(2),
            "readouts": control.Readouts(2),
        },
    ),
    "ErrorsAndReference": (control.ErrorsAndReference, {"n_joints": 2}),
    "ConstantGain": (control.ConstantGain, {"adaptation_rate": 2.0, "name": "adaptation_rate"}),
    "AdaptiveLaw": (
        lambda parts: control.AdaptiveLaw(parts),
        {"parts": control.ConstantGain(2.0)},
    ),
    "SigmaModification": (control.SigmaModification, {"sigma": 0.1, "prior": 0.5}),
    "EModification": (control.EModification, {"e_modification": 0.1}),
    "Projection": (control.Projection, {"bound": 2.0, "margin": 0.1}),
    "Identity": (control.Identity, {"n_inputs": 2}),
    "Constant": (control.Constant, {"n_inputs": 2}),
    "Joined": (control.Joined, {"bases": [control.Identity(2), control.Constant(2)]}),
    "FunctionBasis": (
        control.FunctionBasis,
        {"function_": torch.sin, "n_inputs": 2, "n_features": 2},
    ),
    "Layers": (control.Layers, {"weights": [torch.eye(2).double()], "biases": [ROW]}),
    "Layers.random": (
        control.Layers.random,
        {"n_inputs": 2, "n_hidden": 3, "layers": 1, "seed": 0},
    ),
    "Measured": (control.Measured, {"width": 2}),
    "Approximator": (
        control.Approximator,
        {
            "network": NETWORK,
            "memory": MEMORY,
            "offers": ("error_norm", "shortfall"),
            "readouts": control.Readouts(2),
        },
    ),
    "Readouts": (
        control.Readouts,
        {"n_slots": 3, "recall_time": 0.1, "sharpness": 1.0, "spread": 0.2, "common": 0.5},
    ),
    "BoundaryLayer": (
        control.BoundaryLayer,
        {"sliding_gain": 1.0, "layer": 0.1, "shape": "smooth"},
    ),
    "IntegralAction": (control.IntegralAction, {"integral_gain": 1.0}),
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
    "RadialBasis": (
        control.RadialBasis,
        {"centers": [[0.0, 1.0], [1.0, 0.0]], "width": 0.5},
    ),
    "RadialBasis.scattered": (
        control.RadialBasis.scattered,
        {"n_inputs": 10, "n_hidden": 6, "width": 0.5, "seed": 1},
    ),
    "LinearNetwork": (
        control.LinearNetwork,
        {"basis": BASIS, "n_outputs": 2, "law": LAW, "start": 0.5},
    ),
}
