"""Problem 2: fast poles that nobody modelled."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from .known import Case, Problem, at_most, closed, printed
from .measures import crossing, largest, largest_norm, mark, output_reaches
from .run import Run


def _matrices(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    scenario = run.experiment.alone or run.experiment.scenario
    found = run.experiment.loop.plant.coefficients(scenario.parameters)
    return found.A.numpy(), found.B.numpy(), found.C.numpy()


def phase_crossing(run: Run) -> float:
    """Where the plant's phase is -180 degrees [rad/s]."""
    A, B, C = _matrices(run)

    def imaginary(w: float) -> float:
        return float((C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B))[0, 0].imag)

    return float(brentq(imaginary, 5.0, 50.0, xtol=1e-12))


def stability_limit(run: Run) -> float:
    """-k_y at which u = k_y y alone is on the border."""
    A, B, C = _matrices(run)
    return float(
        brentq(lambda k: np.linalg.eigvals(A - k * B @ C).real.max(), 1.0, 50.0, xtol=1e-12)
    )


def unstable_from(run: Run) -> float:
    """When k_y passes that border [s]."""
    return crossing(run.arrays["t"], -run.arrays["W"][:, 0, 0] - stability_limit(run))


PROBLEM = Problem(
    "Rohrs' counterexample",
    "Rohrs, Valavani, Athans and Stein 1985",
    {
        "drift": Case(
            "r = 0.3 + 1.85 sin 16.1 t",
            ("problem=rohrs",),
            1e-3,
            (
                closed("phase -180 degrees at [rad/s]", math.sqrt(259.0), phase_crossing),
                closed("-k_y where u = k_y y is unstable", 7800 / 458, stability_limit),
                printed("k_y(10 s)", "-1.69945", *mark("W", 10.0)),
                printed("k_y(20 s)", "-12.6394", *mark("W", 20.0)),
                printed(
                    "k_y crosses it at [s]",
                    "20.36330",
                    unstable_from,
                    source="SciPy, rtol 1e-12",
                    note="benchmarks.md prints 20.364, the first whole millisecond after it",
                ),
                printed("|y| = 50 at [s]", "21.090", output_reaches(50.0)),
            ),
            ("W",),
        ),
        "bounded": Case(
            "r = 0.3 + 2 sin 8 t",
            ("problem=rohrs_bounded",),
            0.02,
            (
                printed(
                    "max |y|",
                    "3.024295",
                    largest("output"),
                    source="SciPy, rtol 1e-10",
                    note="benchmarks.md prints 3.0240, of a grid that misses the peak",
                ),
                printed("k_y(10 s)", "-8.4445", *mark("W", 10.0)),
                printed("k_y(20 s)", "-8.0922", *mark("W", 20.0)),
                printed("k_y(80 s)", "-5.4877", *mark("W", 80.0)),
            ),
            ("W",),
        ),
        "ideal": Case(
            "without the fast poles",
            ("problem=rohrs_ideal",),
            0.02,
            (
                printed("k_y(20 s)", "-0.7115", *mark("W", 20.0)),
                printed("k_r(20 s)", "1.3493", *mark("W", 20.0, 1)),
            ),
            ("W",),
        ),
        "sigma": Case(
            "sigma = 0.2",
            ("problem=rohrs_sigma",),
            0.02,
            (
                printed(
                    "max |y|",
                    "0.4445",
                    largest("output"),
                    note="benchmarks.md says of k_y alone, with which it is lost, see below",
                ),
            ),
            ("W",),
        ),
        "sigma_one": Case(
            "sigma = 0.2 on k_y",
            ("problem=rohrs_sigma_one",),
            0.02,
            (
                printed(
                    "|y| = 1000 at [s]",
                    "26.4769",
                    output_reaches(1000.0),
                    source="SciPy, rtol 1e-10",
                ),
            ),
            ("W",),
        ),
        "projection": Case(
            "projection, 10 and 0.1",
            ("problem=rohrs_projection",),
            0.02,
            (
                printed("max |y|", "1.799", largest("output")),
                at_most("largest norm of the gains", 10.0, largest_norm("W")),
            ),
            ("W",),
        ),
    },
)
