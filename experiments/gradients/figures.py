"""Pictures of a gradient report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..runs.figures import beside
from .elasticities import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLES = ("--", "-.", ":", (0, (5, 1)), (0, (1, 1)), (0, (3, 1, 1, 1)))
COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:purple", "tab:orange", "tab:brown")


def landscapes(findings: Findings, title: str) -> Figure:
    """The objective along each constant, every draw and their mean, with each mode's slope."""
    count = len(findings.labels)
    columns = min(3, count)
    lines = -(-count // columns)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * columns, 3.6 * lines + 0.8), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False).reshape(-1)
    shown = [
        estimate
        for estimate in findings.estimates
        if estimate.mode == findings.judge or not estimate.mode.startswith("fd")
    ]
    for number, label in enumerate(findings.labels):
        ax, landscape = axes[number], findings.landscapes[number]
        change = 100.0 * np.expm1(landscape.z.numpy())
        value = landscape.value.numpy()
        ax.plot(change, value / value[len(change) // 2], color="0.85", lw=0.7, zorder=0)
        mean = value.mean(axis=1)
        ax.plot(change, mean, "k.-", lw=1.2, ms=4, label="mean of draws")
        z = landscape.z.numpy()
        for style, colour, estimate in zip(STYLES, COLOURS, shown, strict=False):
            slope = estimate.intervals[number].mean
            ax.plot(change, 1.0 + slope * z, ls=style, color=colour, lw=1.2, label=estimate.mode)
        spread = max(np.ptp(mean), 1e-3)
        ax.set_ylim(mean.min() - 0.6 * spread, mean.max() + 0.6 * spread)
        ax.set_title(label, fontsize="medium")
        ax.set_xlabel("change [%]")
        ax.set_ylabel("SRMSE / present")
    for ax in axes[count:]:
        ax.set_axis_off()
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small"
    )
    figure.suptitle(title)
    return figure


def norms(findings: Findings, title: str) -> Figure:
    """Norm of the mean gradient against the horizon."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.2), layout="constrained")
    ax = figure.subplots()
    for mode, series in findings.norms.items():
        horizon, norm = zip(*series, strict=True)
        ax.plot(horizon, norm, "o-" if len(series) > 1 else "s", label=mode)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("horizon [s]")
    ax.set_ylabel("norm of the elasticities")
    ax.grid(alpha=0.3, which="both")
    beside(ax, fontsize="small")
    ax.set_title(title)
    return figure
