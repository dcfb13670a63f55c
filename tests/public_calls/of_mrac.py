"""Calls of model-reference controllers, and of what they are given."""

from __future__ import annotations

from mann_torch import control
from tests.public_calls.of_control import MEMORY
from tests.public_calls.things import Call

MODEL, INPUT = [[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]]
LIMITED = {"A": MODEL, "B": INPUT, "input_limit": 2.0}
NETWORK = control.LinearNetwork(control.RadialBasis.scattered(3, 6), 1)
OF_ANY = {
    "network": NETWORK,
    "memory": MEMORY,
    "feedback": [[1.0, 2.0]],
    "feedforward": [[1.0]],
    "error_feedback": [[0.1, 0.2]],
    "robust": control.BoundaryLayer(),
    "integral": control.IntegralAction(),
    "saturation": control.Hedging(MODEL, INPUT, 2.0),
    "labels": control.MeasuredLabels("moment"),
    "readouts": control.Readouts(2),
}

CALLS: dict[str, Call] = {
    "Mrac": (control.Mrac, {"error_gain": [[0.5, 0.5]], **OF_ANY}),
    "Mrac.of_model": (
        control.Mrac.of_model,
        {"A": MODEL, "B": INPUT, "Q": 2.0, "network": NETWORK, "error_feedback": [[0.1, 0.2]]},
    ),
    "OutputMrac": (
        control.OutputMrac,
        {
            "filter_rates": [2.0],
            "network": control.LinearNetwork(control.RadialBasis.scattered(4, 6), 1),
            "memory": MEMORY,
            "robust": control.BoundaryLayer(),
        },
    ),
    "InputOutputFilters": (control.InputOutputFilters, {"filter_rates": [1.0, 2.0]}),
    "AugmentedError": (control.AugmentedError, {**LIMITED, "deficit_rate": 1.0, "start": 0.5}),
    "KnownLimits": (control.KnownLimits, {"input_limit": 2.0}),
    "Hedging": (control.Hedging, LIMITED),
    "MuModification": (
        control.MuModification,
        {**LIMITED, "mu": 1.0, "limit_margin": 0.1, "deficit_rate": 1.0, "start": 0.5},
    ),
    "FilteredLabels": (control.FilteredLabels, {"A": MODEL, "B": INPUT, "label_rate": 5.0}),
    "MeasuredLabels": (control.MeasuredLabels, {"field": "moment"}),
}
