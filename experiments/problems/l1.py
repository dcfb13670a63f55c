"""Problem 8: L1 adaptive control."""

from __future__ import annotations

import math

import numpy as np

from mann_torch.control import l1_gain

from .known import Case, Known, Measure, Problem, at_least, at_most, closed, printed
from .run import Run

MODEL, INPUT = [[0.0, 1.0], [-1.0, -1.4]], [[0.0], [1.0]]
#: |theta|_1 of the box that estimates are kept in.
BOUND = 20.0
STEPS = (25, 100, 400)
#: The scalar loop of the piecewise-constant law.
RATE, GAIN, PUSH, PERIOD = -1.5, 2.0, 0.7, 0.02
_SAMPLES = 5  # of that law


def _norm(bandwidth: float, row: int) -> Measure:
    return lambda run: float(l1_gain(MODEL, INPUT, bandwidth)[row, 0])


def _norms(bandwidth: float, rows: tuple[str, str], times: str) -> tuple[Known, ...]:
    def condition(run: Run) -> float:
        return BOUND * float(l1_gain(MODEL, INPUT, bandwidth).max())

    told = f"w_c = {bandwidth:g}"
    each = [
        printed(f"L1 norm, row {row + 1}, {told}", digits, _norm(bandwidth, row))
        for row, digits in enumerate(rows)
    ]
    return (*each, printed(f"times 20, largest, {told}", times, condition))


def apart(run: Run) -> float:
    """How far responses over their steps are from the first's, at most."""
    every = [one.arrays["output"][:, 0] for one in (run, *run.others)]
    scaled = [y / step for y, step in zip(every, STEPS, strict=False)]
    return float(max(np.abs(y - scaled[0]).max() for y in scaled))


def _step_of(problem: str, step: int) -> tuple[str, ...]:
    return (f"problem={problem}", f"scenario.reference.coefficients=[[{step}.0]]")


def _estimate(run: Run) -> float:
    """Of the sample that is off most."""
    found = run.arrays["sigma"].reshape(-1)[2 : 2 + _SAMPLES]
    wanted = math.exp(RATE * PERIOD) * PUSH
    return float(found[np.abs(found - wanted).argmax()])


def _prediction_error(run: Run) -> float:
    gap = (run.arrays["predicted"] - run.arrays["x"]).reshape(-1)[1 : 1 + _SAMPLES]
    wanted = -GAIN * PUSH * (math.exp(RATE * PERIOD) - 1) / RATE
    return float(gap[np.abs(gap - wanted).argmax()])


PROBLEM = Problem(
    "L1 adaptive control",
    "Hovakimyan and Cao 2010",
    {
        "steps": Case(
            "L1, steps of 25, 100 and 400",
            ("problem=l1",),
            0.01,
            (
                *_norms(30.0, ("0.032027", "0.071871"), "1.437"),
                *_norms(160.0, ("0.006008", "0.014740"), "0.295"),
                at_most("responses apart, over their steps", 1e-4, apart),
            ),
            ("estimate",),
            others=tuple(_step_of("l1", step) for step in STEPS[1:]),
        ),
        "mrac": Case(
            "MRAC, the same steps",
            ("problem=l1_mrac",),
            0.01,
            (at_least("responses apart, over their steps", 0.1, apart),),
            ("W",),
            others=tuple(_step_of("l1_mrac", step) for step in STEPS[1:]),
        ),
        "piecewise": Case(
            "piecewise-constant law",
            ("problem=l1_piecewise",),
            PERIOD,
            (
                closed("sigma^ from the first sample on", math.exp(-0.03) * PUSH, _estimate),
                closed(
                    "x~ from the first sample on",
                    -GAIN * PUSH * (math.exp(RATE * PERIOD) - 1) / RATE,
                    _prediction_error,
                ),
            ),
            ("sigma", "prediction_error"),
        ),
    },
)
