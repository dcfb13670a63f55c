"""Pictures of a memory at work: one batch member's attention, contents and reallocations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from .figures import COLOURS


def attention_and_contents(
    runs: Mapping[str, Mapping[str, np.ndarray]],
    t: np.ndarray,
    title: str,
    marks: Sequence[float] = (),
    unit: str = "step",
) -> Figure:
    """Weights over time with resets in red, and all slots' contents below; a column a variant.

    `runs` are `MemoryTrace.member` arrays (T, .) by variant, `t` (T,) their times, `marks` times at
    which the task changed.
    """
    figure = Figure(figsize=(5.2 * len(runs), 6.0), layout="constrained")
    axes = figure.subplots(2, len(runs), sharex=True, squeeze=False, height_ratios=(1, 2))
    for column, (name, run) in enumerate(runs.items()):
        top, bottom = axes[0][column], axes[1][column]
        n_slots, width = run["mu"].shape[-2:]
        half = 0.5 * (t[1] - t[0]) if len(t) > 1 else 0.5
        ends = (t[0] - half, t[-1] + half)
        top.imshow(
            run["weights"].T,
            aspect="auto",
            origin="lower",
            interpolation="nearest",
            vmin=0,
            vmax=1,
            cmap="Blues",
            extent=(*ends, 0.5, n_slots + 0.5),
        )
        resets = t[np.diff(run["reallocations"], prepend=0) > 0]
        top.plot(resets, np.full(len(resets), n_slots + 0.4), "|", color="tab:red", ms=5)
        top.set_yticks(range(1, n_slots + 1))
        top.set_ylabel("slot")
        top.set_title(f"{name}: weights, {int(run['reallocations'][-1])} resets", fontsize="medium")
        image = bottom.imshow(
            run["mu"].reshape(len(t), -1).T,
            aspect="auto",
            origin="lower",
            interpolation="nearest",
            cmap="viridis",
            extent=(*ends, 0.5, n_slots + 0.5),
        )
        figure.colorbar(image, ax=bottom, shrink=0.8)
        bottom.set_yticks(range(1, n_slots + 1))
        bottom.set_ylabel(rf"slot: $\mu_i$, {width} numbers each")
        bottom.set_xlabel(unit)
        for ax in (top, bottom):
            for mark in marks:
                ax.axvline(mark, color="0.3", lw=0.5, ls=":")
    figure.suptitle(title)
    return figure


def curves(
    lines: Mapping[str, np.ndarray],
    x: Mapping[str, np.ndarray],
    labels: tuple[str, str],
    title: str,
    log: bool = False,
    marks: Sequence[float] = (),
) -> Figure:
    """One line a variant, (T,) each against its own x (T,)."""
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    ax = figure.subplots()
    colours = (*COLOURS, "tab:brown", "tab:gray", "tab:olive")
    for colour, (name, values) in zip(colours, lines.items(), strict=False):
        ax.plot(x[name], values, lw=1.0, color=colour, label=name)
    for mark in marks:
        ax.axvline(mark, color="0.8", lw=0.6, zorder=0)
    ax.set_xlabel(labels[0])
    ax.set_ylabel(labels[1])
    if log:
        ax.set_yscale("log")
    ax.legend(fontsize="small", ncols=2)
    ax.set_title(title)
    return figure
