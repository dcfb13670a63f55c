"""Problem 1: features learned for a quadrotor in wind."""

from __future__ import annotations

import numpy as np

from .known import Case, Known, Problem, single
from .measures import mark
from .run import Run

#: Samples of the published means, t = 0, 0.01, ..., 10 s.
COUNT = 1001


def error_norms(run: Run) -> np.ndarray:
    """Of the 6 errors at samples."""
    value, rate = run.wanted(run.arrays["t"])
    gaps = (run.arrays["q"] - value, run.arrays["qd"] - rate)
    return np.asarray(np.linalg.norm(np.concatenate(gaps, axis=-1), axis=-1)[:COUNT])


def rms_error(run: Run) -> float:
    """Over samples."""
    return float(np.sqrt(np.square(error_norms(run)).mean()))


def rms_input(run: Run) -> float:
    """Over samples: a tick's command is what is held one sample later."""
    clock = run.trajectory.held.clock
    if clock is None:  # the same at all instants: no tick is told from another
        return float("nan")
    held = clock.input.numpy()
    u = held.reshape(len(held), -1)[1 : COUNT + 1]
    return float(np.sqrt(np.square(u).sum(-1).mean()))


def _known(rms: str, effort: str, peak: str, middle: tuple[str, str, str]) -> tuple[Known, ...]:
    return (
        single("RMS of the 6 errors", rms, rms_error),
        single("RMS u", effort, rms_input),
        single("largest |e|", peak, lambda run: float(error_norms(run).max())),
        *(single(f"q_{k + 1}(5 s)", q, *mark("q", 5.0, k)) for k, q in enumerate(middle)),
    )


_WITHOUT_WEIGHTS = "its features are not in the authors' file that we have"

PROBLEM = Problem(
    "Quadrotor in wind",
    "Richards, Azizan, Slotine and Pavone 2021, arXiv 2103.04490",
    {
        "pid": Case(
            "PID",
            ("problem=quadrotor_pid", "horizon=10.01"),
            0.01,
            (
                *_known("0.912149", "32.916096", "1.148057", ("2.888483", "5.705446", "1.047198")),
                single("q_1(10 s)", "3.428703", *mark("q", 10.0, 0)),
                single("q_2(10 s)", "0.370175", *mark("q", 10.0, 1)),
                single("q_3(10 s)", "0", *mark("q", 10.0, 2)),
            ),
            ("W",),
        ),
        "learned": Case(
            "learned features",
            ("problem=quadrotor_learned", "horizon=10.01"),
            0.01,
            (
                *_known("0.050251", "31.629438", "0.108807", ("2.017055", "6.000923", "1.047198")),
                *(
                    single(f"{name}, least squares", digits, None, note=_WITHOUT_WEIGHTS)
                    for name, digits in (
                        ("RMS of the 6 errors", "0.331537"),
                        ("RMS u", "32.511390"),
                        ("largest |e|", "0.524647"),
                    )
                ),
            ),
            ("force",),
        ),
    },
)
