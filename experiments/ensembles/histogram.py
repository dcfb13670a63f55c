"""How SRMSE is spread over an ensemble."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..runs.figures import beside, symbol, with_unit
from .rollouts import Rollouts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Quantile lines; what lies beyond the last of `_SHOWN` is told, not drawn.
_LINES = {"5 %": (0.05, ":"), "median": (0.5, "-"), "95 %": (0.95, "--"), "99 %": (0.99, "-.")}
_SHOWN = 0.999


def histogram(ensembles: Mapping[str, Rollouts], title: str) -> Figure:
    """A row an ensemble, a column an output; the axis is shared by a column."""
    from matplotlib.figure import Figure

    units = {n: u for r in ensembles.values() for n, u in r.outputs.tolist()}
    size = (6.5 * max(1, len(units)), 0.8 + 3.0 * len(ensembles))
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(ensembles), len(units), squeeze=False, sharex="col")
    for column, (output, unit) in enumerate(units.items()):
        errors = {name: _errors(rollouts, output) for name, rollouts in ensembles.items()}
        finite = [values for values in errors.values() if len(values)]
        if finite:
            least = min(values.min() for values in finite)
            most = max(np.quantile(values, _SHOWN) for values in finite)
            bins = min(60, max(10, int(max(map(len, finite)) ** 0.5)))
            edges = np.linspace(least, max(most, least + 1e-9), bins + 1)
            for ax, (name, values) in zip(grid[:, column], errors.items(), strict=True):
                _panel(ax, values, edges)
                ax.set_title(name, fontsize="medium")
                ax.set_ylabel("rollouts")
        label = rf"SRMSE of {symbol(output)} x $10^3$"
        grid[-1][column].set_xlabel(with_unit(label, unit))
    figure.suptitle(title)
    return figure


def _errors(rollouts: Rollouts, output: str) -> np.ndarray:
    """10^3 times the SRMSE of an output, of those that came to their end and have it."""
    if output not in rollouts.names:
        return np.empty(0)
    return 1e3 * rollouts.srmse[rollouts.ok, rollouts.names.index(output)]


def _panel(ax: Axes, values: np.ndarray, edges: np.ndarray) -> None:
    ax.hist(values, edges.tolist(), color="0.75")
    if not len(values):
        return
    for name, (share, style) in _LINES.items():
        place = float(np.quantile(values, share))
        ax.axvline(place, color="tab:red", ls=style, lw=1.2, label=f"{name}: {place:.3f}")
    ax.axvline(values.mean(), color="tab:blue", lw=1.2, label=f"mean: {values.mean():.3f}")
    beyond = int((values > edges[-1]).sum())
    rest = f"{beyond} beyond, to {values.max():.3f}" if beyond else None
    beside(ax, fontsize="small", title=rest)
