"""Every reference of the library, by name: what the contracts run over."""

from __future__ import annotations

import math
from collections.abc import Callable

from mann_torch.signals import (
    MinimumJerk,
    Polynomial,
    Quintic,
    Reference,
    Sinusoid,
    Sinusoids,
    SmoothSteps,
    Spline,
    SquareWave,
    Steps,
    Sum,
)

TIMES, POINTS = [1.0, 2.5, 3.0, 6.0], [[0.0, 1.0], [2.0, -1.0], [0.5, 0.3], [-1.0, 0.0]]

MAKERS: dict[str, Callable[[], Reference]] = {
    "sinusoid": lambda: Sinusoid([1.0, 0.3], [0.5, 0.7], [0.0, 0.1]),
    "sinusoids": lambda: Sinusoids(
        [[1.0, 0.3], [0.2, 0.4]], [[0.5, 0.7], [2.0, 3.0]], [[0.0, 0.1], [0.4, 0.2]], [0.1, 0.2]
    ),
    "steps": lambda: Steps(TIMES[:3], POINTS),
    "steps padded": lambda: Steps([[1.0, math.inf], [1.0, 2.0]], [POINTS[:3], POINTS[1:]]),
    "square_wave": lambda: SquareWave([1.0, 0.4], [20.0, 3.0], 0.1, [0.0, 1.0]),
    "smooth_steps": lambda: SmoothSteps(TIMES[:3], POINTS, 1.2),
    "smooth_steps 7": lambda: SmoothSteps(TIMES[:3], POINTS, [0.3, 0.5, 2.0], 7),
    "minimum_jerk": lambda: MinimumJerk(TIMES, POINTS),
    "quintic": lambda: Quintic(TIMES, POINTS, [[0.1, 0.2]], -1.0),
    "polynomial": lambda: Polynomial([[1.0, 2.0], [0.3, 0.0], [0.0, -0.1]]),
    "constant": lambda: Polynomial([[1.0, 2.0]]),
    "spline": lambda: Spline(TIMES, POINTS),
    "spline clamped": lambda: Spline(TIMES, POINTS, ends="clamped", end_velocities=[1.0, 2.0]),
    "spline 5": lambda: Spline(TIMES, POINTS, degree=5),
    "sum": lambda: Sum(
        [
            Polynomial([[1.0, 2.0], [0.3, 0.0]]),
            Sinusoid([[1.0, 0.3], [0.5, 0.5]]),
            SmoothSteps(TIMES[:3], POINTS, 1.2),
        ]
    ),
    "sum with a jump": lambda: Sum([Steps(TIMES[:3], POINTS), Sinusoid([1.0, 1.0])]),
}
