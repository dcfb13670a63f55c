"""Measures that several problems share: functions of a run that give a number."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .known import Mark, Measure
from .run import Run


def sample(array: str, time: float, column: int = 0) -> Measure:
    """A number of an array at a sample [s]."""
    return lambda run: float(run.at(array, time)[column])


def mark(array: str, time: float, column: int = 0) -> tuple[Measure, Mark]:
    """The same, and where it stands in a picture."""
    return sample(array, time, column), Mark(array, column, time)


def largest(name: str, column: int = 0, scale: float = 1.0) -> Measure:
    """The largest absolute `output` or `error`, between steps too."""
    return lambda run: scale * peak(np.abs(run.course(name)[:, column]))


def peak(rows: np.ndarray) -> float:
    """The top of the parabola through the largest row and those beside it."""
    k = int(rows.argmax())
    if not 0 < k < len(rows) - 1:
        return float(rows[k])
    left, middle, right = rows[k - 1 : k + 2].tolist()
    bend = 2 * middle - left - right
    return middle + (right - left) ** 2 / (8 * bend) if bend > 0 else middle


def largest_norm(array: str) -> Measure:
    """Of an array's rows at samples."""
    return lambda run: float(np.linalg.norm(_rows(run, array), axis=-1).max())


def growth(array: str, off: Callable[[np.ndarray], np.ndarray]) -> Measure:
    """The largest step up of any column of `off` of an array's rows, from sample to sample."""
    return lambda run: float(np.diff(off(_rows(run, array)), axis=0).max())


def crossing(t: np.ndarray, above: np.ndarray) -> float:
    """When a rising quantity first passes 0 [s], linearly between rows; NaN where it does not."""
    reached = np.flatnonzero(above >= 0)
    if not len(reached) or reached[0] == 0:
        return float("nan")
    k = int(reached[0])
    share = -above[k - 1] / (above[k] - above[k - 1])
    return float(t[k - 1] + share * (t[k] - t[k - 1]))


def output_reaches(level: float) -> Measure:
    """When the absolute first output passes a level [s]."""
    return lambda run: crossing(run.t, np.abs(run.course("output")[:, 0]) - level)


def simpson(t: np.ndarray, rate: np.ndarray) -> float:
    """Integral over all steps, pairs of equal ones."""
    width = np.diff(t).reshape(-1, 2).sum(axis=1)
    return float(np.sum(width / 6 * (rate[:-1:2] + 4 * rate[1::2] + rate[2::2])))


def _rows(run: Run, array: str) -> np.ndarray:
    rows = run.arrays[array]
    return rows.reshape(len(rows), -1)
