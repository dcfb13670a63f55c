"""Pictures of tuning runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mann_torch.tuning import Score

from ..runs.figures import beside
from .held_out import PEAK_LIMIT, START, Candidate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:purple", "tab:orange", "tab:brown", "tab:pink")


def progress_curves(
    history: Sequence[Mapping[str, Any]], labels: Sequence[str], starts: Sequence[float]
) -> Figure:
    """Objective and every coordinate's constant, relative to its start, against iterations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    steps = [row["iteration"] + 1 for row in history]
    left.plot(steps, [row["objective"] for row in history], color="k", lw=1.2)
    left.set_ylabel("objective (start: 1 + effort weight)")
    z = np.array([row["z"] for row in history])
    for number, label in enumerate(labels):
        style = "-" if number < len(COLOURS) else "--"
        name = f"{label} (from {starts[number]:g})"
        right.plot(
            steps, np.exp(z[:, number]), style, color=COLOURS[number % len(COLOURS)], label=name
        )
    right.set_yscale("log")
    right.set_ylabel("constant / start")
    beside(right, fontsize="x-small")
    for ax in (left, right):
        ax.set_xlabel("iteration")
        ax.grid(alpha=0.3)
    return figure


def pareto(
    scores: Mapping[str, Score], candidates: Sequence[Candidate], chosen: Sequence[str], title: str
) -> Figure:
    """SRMSE against input rate, relative to the start, a panel a scenario.

    Grid points are grey, hollow where their peak input is over the limit; a line joins those that
    no other grid point within the limit beats.
    """
    from matplotlib.figure import Figure

    columns = min(2, len(scores))
    lines = -(-len(scores) // columns)
    figure = Figure(figsize=(7.4 * columns, 4.2 * lines + 0.6), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False).reshape(-1)
    names = [candidate.name for candidate in candidates]
    for ax, (scenario, score) in zip(axes, scores.items(), strict=False):
        srmse, rate, peak = (leaf.mean(dim=1).numpy() / float(leaf[0].mean()) for leaf in score)
        grid = np.array([i for i, name in enumerate(names) if name not in (START, *chosen)], int)
        inside = grid[peak[grid] <= PEAK_LIMIT] if len(grid) else grid
        outside = grid[~(peak[grid] <= PEAK_LIMIT)] if len(grid) else grid
        ax.scatter(rate[outside], srmse[outside], s=14, facecolors="none", edgecolors="0.6")
        ax.scatter(rate[inside], srmse[inside], s=14, color="0.6", label="grid")
        front = _front(rate[inside], srmse[inside])
        ax.plot(rate[inside][front], srmse[inside][front], color="0.6", lw=0.8)
        ax.plot(1.0, 1.0, "ko", ms=7, label=START)
        for colour, name in zip(COLOURS, chosen, strict=False):
            i = names.index(name)
            hollow = not peak[i] <= PEAK_LIMIT
            ax.plot(
                rate[i],
                srmse[i],
                "*",
                ms=13,
                color=colour,
                mfc="none" if hollow else colour,
                label=f"{name} (peak x {peak[i]:.2f})",
            )
        ax.axvline(1.0, color="k", lw=0.6, ls=":")
        ax.axhline(0.5, color="k", lw=0.6, ls=":")
        ax.set_xlim(0, min(3.0, 1.1 * np.nanmax(rate)))
        ax.set_ylim(0, min(2.5, 1.1 * np.nanmax(srmse)))
        ax.set_title(f"scenario {scenario}")
        ax.set_xlabel("RMS input rate / start")
        ax.set_ylabel("SRMSE / start")
        beside(ax, fontsize="x-small")
    for ax in axes[len(scores) :]:
        ax.set_axis_off()
    figure.suptitle(title)
    return figure


def _front(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices of points that no other is below and left of, by x."""
    order = np.lexsort((y, x))
    kept, best = [], np.inf
    for i in order:
        if y[i] < best:
            kept.append(i)
            best = y[i]
    return np.array(kept, int)
