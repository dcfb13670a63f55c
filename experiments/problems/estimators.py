"""Problem 5: estimators on (sin t, cos t), whose answers are closed forms."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad_vec
from scipy.linalg import expm

from .known import Case, Known, Mark, Measure, Problem, at_most, closed, printed
from .measures import growth, mark
from .run import Run

#: What estimates are off at the start, and what is sought.
OFF, SOUGHT = np.array([1.0, 2.0]), np.array([-1.0, -2.0])


def error(time: float, column: int) -> tuple[Measure, Mark]:
    """theta^ - theta* at a sample [s], and where it stands in a picture."""

    def off(run: Run) -> float:
        return float(run.at("theta", time)[column] - SOUGHT[column])

    return off, Mark("theta", column, time, float(SOUGHT[column]))


def by_gradient(gamma: float, t: float) -> np.ndarray:
    """What estimates are off."""
    c, s = math.cos(t), math.sin(t)
    turned = np.array([[c, s], [-s, c]])
    return np.asarray(turned @ expm(np.array([[0.0, -1.0], [1.0, -gamma]]) * t) @ OFF)


def by_least_squares(P_0: float, forgetting: float, t: float) -> np.ndarray:
    """What estimates are off, from P(0) = P_0 I."""

    def seen(tau: float) -> np.ndarray:
        phi = np.array([math.sin(tau), math.cos(tau)])
        return np.asarray(math.exp(-forgetting * (t - tau)) * np.outer(phi, phi))

    gathered = quad_vec(seen, 0.0, t, epsabs=1e-13, epsrel=1e-13)[0]
    kept = math.exp(-forgetting * t) / P_0
    return np.asarray(kept * np.linalg.solve(kept * np.eye(2) + gathered, OFF))


def of_stack(t: float) -> np.ndarray:
    """From (1, 0) and (1, 1), at a gain of 0.5."""
    points = np.array([[1.0, 0.0], [1.0, 1.0]])
    return np.asarray(expm(-0.5 * points.T @ points * t) @ OFF)


def offset(t: float) -> np.ndarray:
    """x and theta^ at a time [s], from 0."""
    a, d, gamma, sigma = 1.0, 1.0, 2.0, 0.1
    rates = np.array([[-a, -1.0], [gamma, -gamma * sigma]])
    rest = np.array([sigma * d, d]) / (1 + a * sigma)
    return np.asarray(rest - expm(rates * t) @ rest)


def _both(time: float, wanted: np.ndarray, told: str = "") -> tuple[Known, ...]:
    return tuple(
        closed(f"theta~_{k + 1}({time:g} s){told}", float(wanted[k]), *error(time, k))
        for k in range(2)
    )


def _printed(time: float, digits: tuple[str, str]) -> tuple[Known, ...]:
    return tuple(
        printed(f"theta~_{k + 1}({time:g} s)", text, *error(time, k))
        for k, text in enumerate(digits)
    )


def _mixed(time: float) -> Measure:
    return lambda run: float(np.linalg.det(run.at("Phi", time).reshape(2, 2)))


def _second(measure: Measure) -> Measure:
    """Of the rollout beside."""
    return lambda run: measure(run.others[0])


def _estimate(time: float) -> Measure:
    """theta^ of the offset: the library's estimate with the other sign."""
    return lambda run: -float(run.at("W", time)[0])


PROBLEM = Problem(
    "Estimators",
    "closed forms",
    {
        "gradient": Case(
            "gradient, gamma = 1",
            ("problem=estimator_gradient",),
            0.05,
            (
                *_printed(20.0, ("3.629456e-5", "-7.191027e-5")),
                *_both(20.0, by_gradient(1.0, 20.0)),
                *(
                    closed(
                        f"theta~_{k + 1}(5 s), gamma = 2",
                        float(by_gradient(2.0, 5.0)[k]),
                        _second(error(5.0, k)[0]),
                    )
                    for k in range(2)
                ),
            ),
            ("theta",),
            others=(("problem=estimator_gradient", "law.constant.adaptation_rate=2.0"),),
        ),
        "least_squares": Case(
            "least squares",
            ("problem=estimator_least_squares",),
            0.05,
            (
                *_printed(5.0, ("0.00239606", "0.00796058")),
                *_both(5.0, by_least_squares(100.0, 0.0, 5.0)),
            ),
            ("theta",),
        ),
        "forgetting": Case(
            "forgetting 0.5",
            ("problem=estimator_forgetting",),
            0.05,
            _both(5.0, by_least_squares(100.0, 0.5, 5.0)),
            ("theta",),
        ),
        "drem": Case(
            "DREM",
            ("problem=estimator_drem",),
            0.05,
            (
                printed("Delta(1 s)", "0.0291433728", _mixed(1.0)),
                printed("Delta(30 s)", "0.2260139196", _mixed(30.0)),
                closed(
                    "the same, 1 / (l^2 (l^2 + 4))", 1 / (0.95**2 * (0.95**2 + 4)), _mixed(30.0)
                ),
                at_most(
                    "largest step up of |theta~_i|",
                    0.0,
                    growth("theta", lambda rows: np.abs(rows - SOUGHT)),
                ),
            ),
            ("theta",),
        ),
        "stack": Case(
            "a frozen stack",
            ("problem=estimator_stack",),
            0.05,
            _both(5.0, of_stack(5.0)),
            ("theta",),
        ),
        "sigma": Case(
            "sigma-modification",
            ("problem=offset_sigma",),
            0.05,
            (
                closed("x(40 s) = sigma d / (1 + a sigma)", 0.1 / 1.1, *mark("x", 40.0)),
                closed("theta(40 s) = d / (1 + a sigma)", 1 / 1.1, _estimate(40.0)),
                closed("x(2 s)", float(offset(2.0)[0]), *mark("x", 2.0)),
                closed("theta(2 s)", float(offset(2.0)[1]), _estimate(2.0)),
            ),
            ("W",),
        ),
    },
)
