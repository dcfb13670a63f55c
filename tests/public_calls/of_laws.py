"""Calls of laws' mechanisms."""

from __future__ import annotations

from mann_torch import control
from tests.public_calls.things import Call

LAW = control.AdaptiveLaw(control.ConstantGain(2.0))

CALLS: dict[str, Call] = {
    "Composite": (control.Composite, {"composite_gain": [0.3, 0.5]}),
    "ConcurrentLearning": (
        control.ConcurrentLearning,
        {
            "learning_gain": 0.3,
            "size": 5,
            "period": 0.5,
            "first": 1.0,
            "keeps": "cycle",
            "rows": 1,
            "points": [[1.0, 2.0]],
            "labels": [[0.5]],
        },
    ),
    "DeadZone": (control.DeadZone, {"dead_zone": 0.1}),
    "Drem": (control.Drem, {"mixing_gain": [1.0, 2.0], "mixing_filter": 0.95}),
    "Estimator": (
        control.Estimator,
        {"law": LAW, "features": "phi", "label": "y", "start": [[1.0], [2.0]]},
    ),
    "LeastSquares": (
        control.LeastSquares,
        {
            "initial_gain": 2.0,
            "forgetting": 0.1,
            "gain_normalisation": 0.1,
            "gain_bound": 10.0,
            "reset_at": 0.1,
        },
    ),
    "Normalisation": (control.Normalisation, {"normalisation": 1.0}),
    "SwitchingSigma": (control.SwitchingSigma, {"switching_sigma": 0.1, "sigma_norm": 2.0}),
}
