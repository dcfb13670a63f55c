"""Calls of the loop's own parts, and of the checks of a model."""

from __future__ import annotations

from mann_torch import parts
from mann_torch.signals import Disturbance, Sinusoid
from mann_torch.testing import check_model, check_sensor
from tests.public_calls.things import Call

WAVE = Sinusoid([1.0, 1.0])

CALLS: dict[str, Call] = {
    "Actuator": (
        parts.Actuator,
        {
            "n_inputs": 2,
            "limit": None,
            "lag": 0.1,
            "rate_limit": [1.0, 2.0],
            "lower": -1.0,
            "upper": 2.0,
        },
    ),
    "Actuator of a limit": (lambda limit: parts.Actuator(2, limit), {"limit": [1.0, 2.0]}),
    "Clock": (parts.Clock, {"period": 0.01, "offset": 0.005, "hold": "first"}),
    "Sensor": (parts.Sensor, {"quantum": 0.1, "delay": 0.02, "period": 0.01}),
    "LinearModel": (
        parts.LinearModel,
        {
            "A": [[0.0, 1.0], [-1.0, -2.0]],
            "B": [[0.0], [1.0]],
            "C": [[1.0, 0.0]],
            "observer_gain": [[1.0], [1.0]],
            "start": [0.0, 0.0],
        },
    ),
    "LinearModel.first_order": (
        parts.LinearModel.first_order,
        {"rate": 2.0, "gain": 1.0, "start": 0.0},
    ),
    "check_sensor": (check_sensor, {"sensor": parts.Sensor(0.1), "n_measured": 3}),
    "check_model": (check_model, {"model": parts.SecondOrderModel(2, 3.0)}),
    "SecondOrderModel": (
        parts.SecondOrderModel,
        {"width": 2, "frequency": 3.0, "damping": [0.7, 1.0]},
    ),
    "Disturbance": (
        Disturbance,
        {"input": WAVE, "output": WAVE, "state": WAVE, "plant": WAVE},
    ),
}
