"""Problem 6: one state, one input, two gains."""

from __future__ import annotations

import numpy as np

from .known import Case, Known, Problem, closed, printed
from .measures import mark, simpson
from .run import Run

#: k_x and k_r that make the loop its model.
IDEAL = (-2.0, 4.0)


def energy(run: Run, time: float) -> float:
    """V = e^2/2 + |k~|^2 / (4 gamma)."""
    gamma = float(run.experiment.loop.constant("adaptation_rate"))
    off = run.at("W", time) - np.array(IDEAL)
    return float(run.at("error", time)[0] ** 2 / 2 + off @ off / (4 * gamma))


def ledger(run: Run) -> float:
    """V(0) - V(end) - integral of 2 e^2."""
    spent = simpson(run.t, 2 * run.course("error")[:, 0] ** 2)
    return energy(run, 0.0) - energy(run, float(run.t[-1])) - spent


def _known(gains: dict[float, tuple[str, str]]) -> tuple[Known, ...]:
    rows = []
    for time, (k_r, k_x) in gains.items():
        for name, column, digits in (("k_r", 1, k_r), ("k_x", 0, k_x)):
            rows.append(printed(f"{name}({time:g} s)", digits, *mark("W", time, column)))
    rows.append(closed("V(0) - V(100 s) - 2 int e^2", 0.0, ledger, floor=1e-8))
    return tuple(rows)


PROBLEM = Problem(
    "Scalar MRAC",
    "Astrom and Wittenmark 1995, example 5.7",
    {
        "slow": Case(
            "gamma = 0.2",
            ("problem=scalar_mrac",),
            0.1,
            _known({20: ("1.55884883", "0.45940876"), 100: ("2.22384735", "-0.16941892")}),
            ("W",),
        ),
        "fast": Case(
            "gamma = 1",
            ("problem=scalar_mrac_fast",),
            0.1,
            _known({20: ("2.09404964", "-0.07769416"), 100: ("3.19081058", "-1.19125163")}),
            ("W",),
        ),
    },
)
