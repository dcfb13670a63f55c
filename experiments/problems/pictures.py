"""A picture a problem: a column a case, over time, what is known marked in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..runs.figures import Arrays, beside, symbol, with_unit
from .known import Case, Mark, Problem
from .rolling import CaseResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMN, _ROW = 4.2, 2.1  # inches
_MOST_LINES = 8
#: A curve that leaves the others behind is cut: this many times the 90 % quantile.
_MOST = 5.0


def picture(problem: Problem, results: Mapping[str, CaseResult]) -> Figure:
    """Output over reference, input, and what each case shows.

    Dotted: outputs of the rollouts beside, scaled as the references are.
    """
    from matplotlib.figure import Figure

    below = max(len(problem.cases[name].shown) for name in results)
    size = (max(6.0, _COLUMN * len(results)), _ROW * (2 + below) + 0.6)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(2 + below, len(results), squeeze=False)
    for column, (name, result) in enumerate(results.items()):
        case, run = problem.cases[name], until(result.arrays, problem.cases[name].until)
        own = axes[:, column]
        own[0].set_title(case.title, fontsize="medium")
        _outputs(own[0], run, case)
        _draw(own[1], run, "input", [symbol(u) for u in run["inputs"][:, 0].tolist()])
        own[1].set_ylabel("input")
        for ax, array in zip(own[2:], case.shown, strict=False):
            _draw(ax, run, array)
            _marks(ax, case, array)
            ax.set_ylabel(array)
        for ax in own[2 + len(case.shown) :]:
            ax.remove()
        own[1 + len(case.shown)].set_xlabel("t [s]")
    figure.suptitle(f"{problem.title} ({problem.source})", fontsize="medium")
    return figure


def until(arrays: Arrays, end: float | None) -> dict[str, np.ndarray]:
    """Samples up to a time [s]."""
    if end is None:
        return dict(arrays)
    kept = arrays["t"] <= end
    return {
        name: array if array.dtype.kind == "U" else array[kept] for name, array in arrays.items()
    }


def _outputs(ax: Axes, run: Arrays, case: Case) -> None:
    for column, (name, unit) in enumerate(run["outputs"].tolist()):
        line = ax.plot(
            run["t"], run["output"][:, column], lw=0.9, label=with_unit(symbol(name), unit)
        )
        ax.plot(run["t"], run["reference"][:, column], "--", lw=0.7, color=line[0].get_color())
    for curve in run["beside"].T if "beside" in run else ():
        ax.plot(run["t"], curve, ":", lw=1.0, color="k")
    for array in run["states"].tolist():
        if _is_output(run, array):
            _marks(ax, case, array)
    scaled = ", .. scaled" if "beside" in run else ""
    ax.set_ylabel(f"output, -- reference{scaled}")
    _fit(ax, run["output"])
    if len(run["outputs"]) > 1:
        beside(ax, fontsize="x-small")


def _is_output(run: Arrays, array: str) -> bool:
    """Whether an array of the state begins with the outputs."""
    width = run["output"].shape[-1]
    return np.array_equal(run[array][:, :width], run["output"])


def _draw(ax: Axes, run: Arrays, array: str, labels: list[str] | None = None) -> None:
    rows = run[array].reshape(len(run["t"]), -1)[:, :_MOST_LINES]
    for column, curve in enumerate(rows.T):
        label = labels[column] if labels else str(column + 1)
        ax.plot(run["t"], curve, lw=0.9, label=label)
    _fit(ax, rows)
    if rows.shape[1] > 1:
        beside(ax, fontsize="x-small")


def _marks(ax: Axes, case: Case, array: str) -> None:
    """What is known, as circles."""
    points = [(known.mark, known.value) for known in case.known if known.mark is not None]
    own: list[tuple[Mark, float]] = [(m, value) for m, value in points if m.array == array]
    if own:
        t, values = [m.time for m, _ in own], [value for _, value in own]
        ax.plot(t, values, "o", mfc="none", mec="k", ms=6, zorder=5)


def _fit(ax: Axes, rows: np.ndarray) -> None:
    """Where a loop is lost, show what came before."""
    size = np.abs(rows[np.isfinite(rows)])
    if len(size) and size.max() > 4 * (most := _MOST * max(float(np.quantile(size, 0.9)), 1e-9)):
        ax.set_ylim(-most, most)
