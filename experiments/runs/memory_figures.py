"""Pictures of what a controller's features and memory did, and of what they are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .figures import COLOURS, Arrays, Symbols, beside, mark_jumps, symbol, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: What `attention_timeline` reads of a run.
ATTENTION = ("attended", "weights", "reallocations")


def attends(run: Arrays) -> bool:
    """Whether a run has a memory to be drawn."""
    return all(name in run for name in ATTENTION)


def with_resets(run: Arrays) -> dict[str, np.ndarray]:
    """One draw's arrays and `reset` (K,): the slot reset since the sample before, -1 for none.

    As far as samples tell: the slot attended after it.
    """
    counts = run["reallocations"]
    new = np.diff(counts, prepend=counts[:1]) > 0
    return {**run, "reset": np.where(new, run["attended"], -1)}


def features_and_read(runs: Mapping[str, Arrays], title: str) -> Figure:
    """sigma and h_o, one line a neuron, one column a controller."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5 * len(runs), 5.5), layout="constrained")
    axes = figure.subplots(2, len(runs), sharex=True, sharey="row", squeeze=False)
    for column, (name, run) in enumerate(runs.items()):
        for row, (key, letter) in enumerate((("hidden", r"$\sigma$"), ("read", "$h_o$"))):
            ax = axes[row][column]
            if key in run:
                ax.plot(run["t"], run[key], lw=0.7)
                ax.set_ylabel(letter)
                mark_jumps(ax, run)
            else:
                ax.text(0.5, 0.5, "no memory", ha="center", transform=ax.transAxes)
        axes[0][column].set_title(name)
        axes[1][column].set_xlabel("t [s]")
    figure.suptitle(title)
    return figure


def is_soft(weights: np.ndarray) -> bool:
    """Whether attention (K, ..., S) is spread over slots rather than on one at a time."""
    return bool(((weights > 0.0) & (weights < 1.0)).any())


def attention_timeline(
    runs: Mapping[str, Arrays], title: str, symbols: Symbols | None = None
) -> Figure:
    """What each controller attends to: a slot and reallocations, or weights; over what changes."""
    from matplotlib.figure import Figure

    with_slots = {name: run for name, run in runs.items() if attends(run)}
    first = next(iter(runs.values()))
    moved = first["parameters"].tolist()
    rows = len(with_slots) + len(moved)
    figure = Figure(figsize=(10, 1.6 + 1.7 * (rows - 1)), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for ax, (name, run) in zip(axes, with_slots.items(), strict=False):
        if is_soft(run["weights"]):
            _weights(ax, run, name)
        else:
            _slots(ax, run, name)
    for ax, (name, unit) in zip(axes[len(with_slots) :], moved, strict=True):
        for entry, values in enumerate(first[name].T):
            label, colour = symbol(f"{name}_{entry + 1}", symbols), COLOURS[entry % len(COLOURS)]
            ax.step(first["t"], values, where="post", color=colour, label=label)
        beside(ax, fontsize="small")
        ax.set_ylabel(with_unit(symbol(name, symbols), unit))
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
