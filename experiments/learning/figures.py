"""A picture of learning: errors over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..runs.figures import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MORE_COLOURS = (*COLOURS, "tab:brown", "tab:gray", "tab:olive", "tab:cyan", "tab:pink")


def errors_over_time(
    lines: Mapping[str, np.ndarray], span: float, starts: Sequence[float], names: Sequence[str]
) -> Figure:
    """RMSE (T,) of every variant, one value a `span` [s], and its difference from the first's.

    A function begins at each of `starts`, called by its name above.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    base_name, base = next(iter(lines.items()))
    for colour, (name, values) in zip(MORE_COLOURS, lines.items(), strict=False):
        t = span * (np.arange(len(values)) + 0.5)
        top.plot(t, values, lw=1.0, color=colour, label=name)
        bottom.plot(t, values - base, lw=1.0, color=colour)
    for ax in (top, bottom):
        for start in starts[1:]:
            ax.axvline(start, color="0.5", lw=0.7, ls=":", zorder=0)
    for start, name in zip(starts, names, strict=True):
        top.annotate(
            name, (start, 1.0), (3, -3), ("data", "axes fraction"), "offset points", va="top"
        )
    top.set_ylabel("RMSE over seeds [-]")
    bottom.set_ylabel(f"RMSE less that of {base_name} [-]")
    bottom.set_xlabel("t [s]; dotted: the function changes")
    figure.legend(loc="outside right upper", fontsize="small")
    figure.suptitle("Online regression: error over time")
    return figure
