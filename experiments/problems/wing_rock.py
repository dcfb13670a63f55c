"""Problem 4: wing rock, and learning from stored data."""

from __future__ import annotations

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from mann_torch.control.lyapunov import lyapunov
from mann_torch.plants import CHOWDHARY_JOHNSON

from .known import Case, Known, Measure, Problem, closed, printed
from .run import Run

#: What the tracking error follows.
_ERRORS_OWN = [[0.0, 1.0], [-1.2, -1.2]]  # A_m - B K_e


def distance(time: float) -> Measure:
    """|W^ - W*|; the library's estimate is what the input needs, -W^."""
    return lambda run: float(np.linalg.norm(run.at("W", time) + np.array(CHOWDHARY_JOHNSON)))


def _lyapunov_entry(row: int, column: int) -> Measure:
    def entry(run: Run) -> float:
        A = torch.tensor(_ERRORS_OWN, dtype=torch.float64)
        return float(lyapunov(A, torch.eye(2, dtype=torch.float64))[row, column])

    return entry


def cycle(run: Run) -> tuple[float, float]:
    """Amplitude and period of the last whole cycles, by splines through all steps."""
    late = run.t > 0.8 * run.t[-1]
    roll = CubicSpline(run.t[late], run.course("output")[late, 0])
    peaks = roll.derivative().roots(extrapolate=False)
    tops = peaks[roll(peaks) > 0]
    return float(roll(tops).max()), float(np.diff(tops).mean())


def _known(at_10: str, at_60: str) -> tuple[Known, ...]:
    return (
        printed("|W^ - W*| at 10 s", at_10, distance(10.0)),
        printed("|W^ - W*| at 60 s", at_60, distance(60.0)),
    )


PROBLEM = Problem(
    "Wing rock",
    "Chowdhary and Johnson 2010; Elzebda, Nayfeh and Mook 1989",
    {
        "mrac": Case(
            "MRAC",
            ("problem=wing_rock",),
            0.1,
            (
                closed("P_11", 17 / 12, _lyapunov_entry(0, 0)),
                closed("P_12", 5 / 12, _lyapunov_entry(0, 1)),
                closed("P_22", 55 / 72, _lyapunov_entry(1, 1)),
                *_known("0.97933", "0.91703"),
            ),
            ("W",),
        ),
        "concurrent": Case(
            "concurrent learning",
            ("problem=wing_rock_concurrent",),
            0.1,
            _known("0.13729", "2.03e-6"),
            ("W",),
        ),
        "open": Case(
            "open loop",
            ("problem=wing_rock_open",),
            1.0,
            (
                printed("amplitude of the limit cycle", "0.607562", lambda run: cycle(run)[0]),
                printed(
                    "period [s]",
                    "56.13727",
                    lambda run: cycle(run)[1],
                    source="SciPy, rtol 1e-12",
                    note="benchmarks.md prints 56.1374",
                ),
            ),
            ("x",),
            until=400.0,
        ),
    },
)
