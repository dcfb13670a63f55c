"""One picture of many runs: lines over numbers, points over names, or a heat map of two numbers."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..runs.figures import beside, with_unit
from .gather import ENGINE, Run, differing
from .measures import NOTHING
from .table import metric_names

_MOST_PANELS, _MOST_LINES = 6, 10
#: Settings in seconds.
_TIMES = ("horizon", "solver.dt", "clock.period", "sensor.period", "sensor.delay")


def picture(runs: Sequence[Run], title: str) -> Figure | None:
    """The leading metric over the settings that differ; None if no run has a metric."""
    names = metric_names(runs)
    if not names:
        return None
    name = names[0]
    unit = next((run.units[name] for run in runs if name in run.units), "")
    label = with_unit(name, unit)
    settings = {key: v for key, v in differing(runs).items() if key != ENGINE}
    settings = settings or {"run": [run.name for run in runs]}
    levels = {key: list(dict.fromkeys(map(_key, v))) for key, v in settings.items()}
    found = [run.metrics.get(name, NOTHING) for run in runs]
    mean, half = (np.array([getattr(f, part) for f in found]) for part in ("mean", "half"))
    # Numbers go along the axis, then what has many values; panels are what is left.
    order = sorted(levels, key=lambda key: (not _numeric(levels[key]), -len(levels[key])))
    if len(order) > 2 and not _numeric(levels[order[1]]) and len(levels[order[0]]) == 2:
        order = [*order[1:], order[0]]  # two numbers make a poor axis: a panel each
    x, lines, rest = order[0], order[1:2], order[2:]
    panels = list(dict.fromkeys(zip(*(map(_key, settings[k]) for k in rest), strict=True)))
    shown = panels[:_MOST_PANELS] if rest else [()]
    figure = Figure(figsize=(2 + 4.5 * len(shown), 4.2), layout="constrained")
    for ax, panel in zip(
        figure.subplots(1, len(shown), squeeze=False, sharey=True)[0], shown, strict=True
    ):
        mine = np.array(
            [tuple(_key(settings[k][i]) for k in rest) == panel for i in range(len(runs))]
        )
        if lines and len(order) == 2 and all(_numeric(levels[key]) for key in order):
            _heat_map(figure, ax, settings, levels, (x, lines[0]), mean, label)
        else:
            _lines(ax, settings, levels, x, lines, mine, mean, half)
            ax.set_ylabel(label)
        ax.set_xlabel(with_unit(x, "s" if x in _TIMES else ""))
        ax.set_title(", ".join(f"{k} {v}" for k, v in zip(rest, panel, strict=True)), fontsize=10)
    left_out = len(panels) - len(shown) if rest else 0
    figure.suptitle(title + (f" ({left_out} more panels in the table)" if left_out else ""))
    return figure


def _lines(
    ax: Axes,
    settings: dict[str, list[Any]],
    levels: dict[str, list[Any]],
    x: str,
    lines: Sequence[str],
    mine: np.ndarray,
    mean: np.ndarray,
    half: np.ndarray,
) -> None:
    numeric = _numeric(levels[x])
    places = np.array([_key(v) if numeric else levels[x].index(_key(v)) for v in settings[x]])
    each = levels[lines[0]][:_MOST_LINES] if lines else [None]
    for number, level in enumerate(each):
        # Names have no order that a line could follow: points, those of one name side by side.
        aside = 0.0 if numeric else 0.5 * ((number + 0.5) / len(each) - 0.5)
        chosen = mine & np.isfinite(mean)
        if lines:
            chosen &= np.array([_key(value) == level for value in settings[lines[0]]])
        at = np.flatnonzero(chosen)
        at = at[np.argsort(places[at], kind="stable")]
        label = f"{lines[0]} {level}" if lines else None
        spread = np.nan_to_num(half[at])
        ax.errorbar(
            places[at] + aside,
            mean[at],
            spread,
            fmt="o-" if numeric else "o",
            ms=4,
            lw=1,
            capsize=3,
            label=label,
        )
    if not numeric:
        ax.set_xticks(range(len(levels[x])), [str(value) for value in levels[x]])
        ax.set_xlim(-0.5, len(levels[x]) - 0.5)
    if lines:
        beside(ax, fontsize=8)


def _heat_map(
    figure: Figure,
    ax: Axes,
    settings: dict[str, list[Any]],
    levels: dict[str, list[Any]],
    axes: tuple[str, str],
    mean: np.ndarray,
    name: str,
) -> None:
    """Where several runs share a cell, their mean."""
    across, up = (sorted(levels[key]) for key in axes)
    grid = np.full((len(up), len(across)), np.nan)
    for (row, y), (column, x) in itertools.product(enumerate(up), enumerate(across)):
        mine = [
            m
            for a, b, m in zip(settings[axes[0]], settings[axes[1]], mean, strict=True)
            if (a, b) == (x, y) and np.isfinite(m)
        ]
        if mine:
            grid[row, column] = np.mean(mine)
    image = ax.imshow(grid, origin="lower", aspect="auto")
    figure.colorbar(image, ax=ax, label=name)
    ax.set_xticks(range(len(across)), [f"{value:g}" for value in across])
    ax.set_yticks(range(len(up)), [f"{value:g}" for value in up])
    ax.set_ylabel(axes[1])


def _key(value: Any) -> Any:
    return value if isinstance(value, int | float | str) else str(value)


def _numeric(values: Sequence[Any]) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
