"""Pictures of trajectories. Arrays are those of `recording.signal_arrays`, for one draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Arrays = Mapping[str, np.ndarray]
COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:purple", "tab:orange")


def one_draw(arrays: Arrays, draw: int) -> dict[str, np.ndarray]:
    """The arrays of one draw: (K, draws, .) -> (K, .); what all draws share stays."""
    draws = arrays["q"].shape[1]
    return {
        name: a[:, draw] if name not in ("t", "masses") and a.shape[1:2] == (draws,) else a
        for name, a in arrays.items()
    }


def with_resets(run: Arrays) -> dict[str, np.ndarray]:
    """One draw's arrays and `reset` (K,): the slot reset since the sample before, -1 for none.

    As far as samples tell: the slot attended after it.
    """
    counts = run["reallocations"]
    new = np.diff(counts, prepend=counts[:1]) > 0
    return {**run, "reset": np.where(new, run["attended"], -1)}


def beside(ax: Axes, *given: Any, **options: Any) -> None:
    """A legend to the right of an axis, off the data."""
    ax.legend(*given, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, **options)


def joint_angles(runs: Mapping[str, Arrays], title: str) -> Figure:
    """x_1 and x_2 of several controllers over the reference, and their errors below."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for joint in range(2):
        top, bottom = axes[0][joint], axes[1][joint]
        for colour, (name, run) in zip(COLOURS, runs.items(), strict=False):
            top.plot(run["t"], run["q"][:, joint], color=colour, lw=1.0, label=name)
            bottom.plot(run["t"], 1e3 * run["error"][:, joint], color=colour, lw=0.8, label=name)
        first = next(iter(runs.values()))
        top.plot(first["t"], first["reference"][:, joint], "k--", lw=0.8, label="reference")
        top.set_ylabel(f"$x_{joint + 1}$ [rad]")
        bottom.set_ylabel(f"$e_{joint + 1}$ [mrad]")
        bottom.set_xlabel("t [s]")
        for ax in (top, bottom):
            _mark_jumps(ax, first)
        _fit_after_start(
            bottom, [(run["t"], 1e3 * run["error"][:, joint]) for run in runs.values()]
        )
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    figure.suptitle(title)
    return figure


def features_and_read(runs: Mapping[str, Arrays], title: str) -> Figure:
    """sigma and h_o, one line a neuron, one column a controller."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5 * len(runs), 5.5), layout="constrained")
    axes = figure.subplots(2, len(runs), sharex=True, sharey="row", squeeze=False)
    for column, (name, run) in enumerate(runs.items()):
        for row, (key, symbol) in enumerate((("hidden", r"$\sigma$"), ("read", "$h_o$"))):
            ax = axes[row][column]
            if key in run:
                ax.plot(run["t"], run[key], lw=0.7)
                ax.set_ylabel(symbol)
                _mark_jumps(ax, run)
            else:
                ax.text(0.5, 0.5, "no memory", ha="center", transform=ax.transAxes)
        axes[0][column].set_title(name)
        axes[1][column].set_xlabel("t [s]")
    figure.suptitle(title)
    return figure


def torques(runs: Mapping[str, Arrays], title: str) -> Figure:
    """tau_1 and tau_2 of several controllers against time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 5.5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for joint, ax in enumerate(axes):
        for colour, (name, run) in zip(COLOURS, runs.items(), strict=False):
            ax.plot(run["t"], run["torque"][:, joint], color=colour, lw=0.8, label=name)
        ax.set_ylabel(rf"$\tau_{joint + 1}$ [N m]")
        _mark_jumps(ax, next(iter(runs.values())))
        _drop_start(ax, [(run["t"], run["torque"][:, joint]) for run in runs.values()])
    axes[-1].set_xlabel("t [s]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    figure.suptitle(title)
    return figure


def is_soft(weights: np.ndarray) -> bool:
    """Whether attention (K, ..., S) is spread over slots rather than on one at a time."""
    return bool(((weights > 0.0) & (weights < 1.0)).any())


def attention_timeline(runs: Mapping[str, Arrays], title: str) -> Figure:
    """What each controller attends to: a slot and reallocations, or weights; over the masses."""
    from matplotlib.figure import Figure

    with_slots = {name: run for name, run in runs.items() if "attended" in run}
    figure = Figure(figsize=(10, 1.6 + 1.7 * len(with_slots)), layout="constrained")
    axes = figure.subplots(len(with_slots) + 1, 1, sharex=True, squeeze=False)[:, 0]
    for ax, (name, run) in zip(axes, with_slots.items(), strict=False):
        if is_soft(run["weights"]):
            _weights(ax, run, name)
        else:
            _slots(ax, run, name)
    first = next(iter(runs.values()))
    for joint, colour in enumerate(COLOURS[:2]):
        axes[-1].step(first["t"], first["masses"][:, joint], where="post", color=colour)
    beside(axes[-1], ["$m_1$", "$m_2$"], fontsize="small")
    axes[-1].set_ylabel("mass [kg]")
    axes[-1].set_xlabel("t [s]")
    figure.suptitle(title)
    return figure


def _slots(ax: Axes, run: Arrays, name: str) -> None:
    n_slots = run["weights"].shape[-1]
    ax.plot(run["t"], run["attended"] + 1, ".", ms=1.5, color="tab:blue")
    resets = run["t"][1:][np.diff(run["reallocations"]) > 0]
    ax.vlines(resets, 0.5, n_slots + 0.5, color="tab:red", lw=0.6, alpha=0.7)
    total = int(run["reallocations"][-1])
    ax.set_title(f"{name}: attended slot, {total} reallocations (red)", fontsize="medium")
    ax.set_yticks(range(1, n_slots + 1))
    ax.set_ylim(0.5, n_slots + 0.5)
    ax.set_ylabel("slot")


def _weights(ax: Axes, run: Arrays, name: str) -> None:
    shares = run["weights"].T
    labels = [f"slot {slot + 1}" for slot in range(len(shares))]
    ax.stackplot(run["t"], shares, labels=labels, colors=COLOURS, edgecolor="w", lw=0.3)
    ax.set_title(f"{name}: attention weights, one on the other", fontsize="medium")
    ax.set_ylabel("$w_r$")
    ax.set_ylim(0.0, 1.0)
    beside(ax, fontsize="small")


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


def _fit_after_start(ax: Axes, curves: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
    """Scale the axis by what comes after the first peak, which is far larger and says little."""
    late = [np.abs(y[t > 5.0]).max() for t, y in curves if t[-1] > 5.0]
    if late:
        ax.set_ylim(-1.2 * max(late), 1.2 * max(late))
        ax.set_title("scaled to t > 5 s", fontsize="small", loc="right")


def _drop_start(ax: Axes, curves: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
    """Scale the axis by what comes after 5 s where what comes before would flatten it."""
    late = np.concatenate([y[(t > 5.0) & np.isfinite(y)] for t, y in curves])
    every = np.concatenate([y[np.isfinite(y)] for _, y in curves])
    if not len(late):
        return
    low, high = late.min(), late.max()
    width = max(high - low, 1e-9)
    if np.ptp(every) > 2.0 * width:
        ax.set_ylim(low - 0.3 * width, high + 0.3 * width)
        ax.set_title("scaled to t > 5 s", fontsize="small", loc="right")


def _mark_jumps(ax: Axes, run: Arrays) -> None:
    changes = np.any(np.diff(run["masses"], axis=0) != 0, axis=-1)
    for time in run["t"][1:][changes]:
        ax.axvline(time, color="0.8", lw=0.6, zorder=0)
