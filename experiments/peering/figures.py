"""Scores against the time of training."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

from mann_torch.statistics import mean_and_half

from ..learning.figures import MORE_COLOURS
from ..sequence_tasks.every import TASKS
from ..settings.peers_config import PeersConfig
from .report import Found
from .training import Learned, test_sequences

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 200


def curves_over(
    runs: Sequence[Learned], grid: np.ndarray, of: str
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and 95 % half-width of the last score at each of `grid`, seconds or iterations (`at`).

    A training that has ended keeps its last score.
    """
    rows = []
    for run in runs:
        place = np.searchsorted(getattr(run, of), grid, side="right") - 1
        rows.append(run.curve[place])
    mean, half = mean_and_half(torch.as_tensor(np.stack(rows)))
    return mean.numpy(), half.numpy()


def learning_curves(cfg: PeersConfig, found: Found) -> Figure:
    """A row a task: the score against time, and against iterations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3 * len(found) + 0.5), layout="constrained")
    rows = figure.subplots(len(found), 2, sharey="row", squeeze=False)
    for (left, right), name in zip(rows, found, strict=True):
        task = TASKS[name](cfg)
        known = task.known(test_sequences(cfg, name))
        for ax, of, label in (
            (left, "seconds", "training [s], one thread"),
            (right, "at", "iterations"),
        ):
            _draw(ax, cfg, found, name, of)
            for (_, score), style in zip(known.items(), (":", "--"), strict=False):
                ax.axhline(score, color="0.4", lw=0.8, ls=style)
            ax.set_xlabel(label)
        if not task.lower_is_better:
            left.set_ylim(-0.03, 1.03)
        left.set_title(name)
        left.set_ylabel(task.measure)
        right.set_title(", ".join(known), fontsize="small", color="0.4")
    handles, labels = rows[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize="small")
    figure.suptitle("Score on the way: mean and 95 % interval over seeds")
    return figure


def _draw(ax: Axes, cfg: PeersConfig, found: Found, name: str, of: str) -> None:
    from matplotlib.ticker import FuncFormatter, LogFormatter

    colours = dict(zip(cfg.variants, MORE_COLOURS, strict=False))
    for variant, runs in found[name].items():
        # From the first evaluation on, as a logarithmic axis has no 0, and on beyond the last.
        moments = np.concatenate([getattr(run, of)[1:] for run in runs])
        if not moments.size:  # diverged before it began
            continue
        grid = np.geomspace(moments.min(), 1.3 * moments.max(), POINTS)
        mean, half = curves_over(runs, grid, of)
        ax.plot(grid, mean, lw=1.3, color=colours[variant], label=variant)
        ax.fill_between(grid, mean - half, mean + half, color=colours[variant], alpha=0.12, lw=0)
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(LogFormatter(minor_thresholds=(1.2, 0.4)))
    ax.tick_params(axis="x", which="both", labelsize="x-small")
