"""The paper's figures, in its symbols, and its numbers beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..runs.figures import Arrays, outputs
from ..runs.memory_figures import attention_timeline, features_and_read

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The paper's names of the arm's joints and masses.
SYMBOLS = {"q_1": "$x_1$", "q_2": "$x_2$"}
SYMBOLS |= {"masses": "mass", "masses_1": "$m_1$", "masses_2": "$m_2$"}


def panel(name: str, runs: Mapping[str, Arrays], title: str) -> Figure:
    """A picture by its name in the plan."""
    if name == "joint_angles":
        return outputs(runs, title, SYMBOLS)
    if name == "attention_timeline":
        return attention_timeline(runs, title, SYMBOLS)
    return features_and_read(runs, title)


def against_paper(rows: Sequence[tuple[str, float, float, float]], title: str) -> Figure:
    """Every published figure beside ours: rows of (label, paper, mean, half-width)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 0.24 * len(rows) + 1.2), layout="constrained")
    ax = figure.subplots()
    y = np.arange(len(rows))[::-1]
    paper = np.array([row[1] for row in rows])
    ours = np.array([row[2] for row in rows])
    spread = np.array([row[3] for row in rows])
    ax.axvspan(-10, 10, color="0.93")
    ax.axvspan(-5, 5, color="0.86")
    ax.errorbar(100 * (ours / paper - 1), y, xerr=100 * spread / paper, fmt="o", ms=4)
    ax.axvline(0, color="k", lw=0.8)
    ax.set_ylim(-1, len(rows))
    ax.set_yticks(y, [row[0] for row in rows], fontsize="x-small")
    ax.set_xlabel("ours / paper - 1 [%], bars: standard deviation over draws")
    ax.set_title(title)
    return figure
