"""Calls of references, and of the check of their contract."""

from __future__ import annotations

from pathlib import Path

from mann_torch import signals
from mann_torch.testing import check_reference
from tests.public_calls.things import Call

TIMES, ROWS = [1.0, 2.0, 4.0], [[0.0], [1.0], [3.0]]
LINE = signals.Polynomial([[1.0], [2.0]])
SAMPLES = Path(__file__).parent.parent / "signals" / "samples.csv"

CALLS: dict[str, Call] = {
    "Sinusoids": (
        signals.Sinusoids,
        {"amplitude": [[1.0]], "frequency": 2.0, "phase": 0.1, "offset": [0.5]},
    ),
    "Steps": (signals.Steps, {"times": TIMES[:2], "values": ROWS}),
    "SquareWave": (
        signals.SquareWave,
        {"amplitude": [1.0], "period": 20.0, "offset": 0.0, "phase": 0.0},
    ),
    "SmoothSteps": (
        signals.SmoothSteps,
        {"times": TIMES[:2], "values": ROWS, "duration": 0.5, "degree": 7},
    ),
    "MinimumJerk": (signals.MinimumJerk, {"times": TIMES, "positions": ROWS}),
    "Quintic": (
        signals.Quintic,
        {"times": TIMES, "positions": ROWS, "velocities": 0.0, "accelerations": [1.0]},
    ),
    "Polynomial": (signals.Polynomial, {"coefficients": [[1.0], [2.0]]}),
    "Sum": (signals.Sum, {"parts": [LINE, signals.Sinusoid([1.0])]}),
    "Spline": (
        signals.Spline,
        {
            "times": TIMES,
            "values": ROWS,
            "degree": 5,
            "ends": "clamped",
            "end_velocities": 0.0,
            "end_accelerations": [[1.0], [0.0]],
        },
    ),
    "Spline.from_file": (
        signals.Spline.from_file,
        {"path": SAMPLES, "degree": 3, "ends": "natural"},
    ),
    "Rows.expand": (LINE.expand, {"batch_shape": (2, 3)}),
    "Rows.select": (LINE.expand((3,)).select, {"members": [0, -1]}),
    "Rows.stack": (LINE.stack, {"others": [LINE, LINE]}),
    "check_reference": (check_reference, {"reference": LINE, "horizon": 5.0}),
}
