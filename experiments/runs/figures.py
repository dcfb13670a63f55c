"""Pictures of trajectories. Arrays are those of `records.arrays.signal_arrays`, for one draw."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Arrays = Mapping[str, np.ndarray]
#: How a channel, a parameter or an entry of one is written in a picture, by name.
Symbols = Mapping[str, str]
COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:purple", "tab:orange")
_SIDE_BY_SIDE = 3  # outputs, at most
_IN_LEGEND = 10  # lines, at most
#: Units whose thousandth is written with an m before it.
_WITH_MILLI = ("rad", "m", "rad/s", "m/s", "V", "A", "s")


def of_draws(arrays: Arrays, which: int | slice) -> dict[str, np.ndarray]:
    """The arrays of one draw, (K, draws, .) -> (K, .), or of some; what all share stays."""
    return {
        name: array if name == "t" or array.dtype.kind == "U" else array[:, which]
        for name, array in arrays.items()
    }


def beside(ax: Axes, *given: Any, **options: Any) -> None:
    """A legend to the right of an axis, off the data."""
    ax.legend(*given, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, **options)


def symbol(name: str, symbols: Symbols | None = None) -> str:
    """A name as text of a picture: as told, else a letter as mathematics, else as it is."""
    told = (symbols or {}).get(name)
    if told is not None:
        return told
    found = re.fullmatch(r"([A-Za-z])(?:_(\d+))?", name)
    if found is None:
        return name
    letter, number = found.groups()
    return f"${letter}$" if number is None else f"${letter}_{{{number}}}$"


def with_unit(text: str, unit: str) -> str:
    """A label; 1 and the empty unit are none."""
    return text if unit in ("", "1") else f"{text} [{unit}]"


def _thousandth(unit: str) -> str:
    if unit in _WITH_MILLI:
        return f"m{unit}"
    return "$10^{-3}$" if unit in ("", "1") else f"$10^{{-3}}$ {unit}"


def outputs(runs: Mapping[str, Arrays], title: str, symbols: Symbols | None = None) -> Figure:
    """Each output of several controllers over the reference, and its error below."""
    from matplotlib.figure import Figure

    first = next(iter(runs.values()))
    channels = first["outputs"].tolist()
    columns = min(len(channels), _SIDE_BY_SIDE)
    blocks = -(-len(channels) // columns)
    size = (max(7.0, 5.5 * columns), 6.2 * blocks)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(2 * blocks, columns, sharex=True, squeeze=False)
    for place, (name, unit) in enumerate(channels):
        block, column = divmod(place, columns)
        top, bottom = axes[2 * block][column], axes[2 * block + 1][column]
        for colour, (label, run) in zip(COLOURS, runs.items(), strict=False):
            top.plot(run["t"], run["output"][:, place], color=colour, lw=1.0, label=label)
            bottom.plot(run["t"], 1e3 * run["error"][:, place], color=colour, lw=0.8, label=label)
        top.plot(first["t"], first["reference"][:, place], "k--", lw=0.8, label="reference")
        if "command" in first:
            top.plot(first["t"], first["command"][:, place], "k:", lw=0.8, label="command")
        top.set_ylabel(with_unit(symbol(name, symbols), unit))
        bottom.set_ylabel(f"$e_{{{place + 1}}}$ [{_thousandth(unit)}]")
        bottom.set_xlabel("t [s]")
        for ax in (top, bottom):
            mark_jumps(ax, first)
        _fit_after_start(
            bottom, [(run["t"], 1e3 * run["error"][:, place]) for run in runs.values()]
        )
    for place in range(len(channels), blocks * columns):
        block, column = divmod(place, columns)
        axes[2 * block][column].remove()
        axes[2 * block + 1][column].remove()
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    figure.suptitle(title)
    return figure


def inputs(runs: Mapping[str, Arrays], title: str) -> Figure:
    """Each input of several controllers against time; dashed, what the plant got of it instead.

    Below them what else acts on the plant, if anything does: a wind.
    """
    from matplotlib.figure import Figure

    first = next(iter(runs.values()))
    channels = [("input", i, *row) for i, row in enumerate(first["inputs"].tolist())]
    channels += [("disturbance", i, *row) for i, row in enumerate(first["disturbances"].tolist())]
    figure = Figure(figsize=(11, 0.9 + 2.3 * len(channels)), layout="constrained")
    axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (kind, place, name, unit) in zip(axes, channels, strict=True):
        curves = []
        for colour, (label, run) in zip(COLOURS, runs.items(), strict=False):
            given = run[kind][:, place]
            ax.plot(run["t"], given, color=colour, lw=0.8, label=label)
            curves.append((run["t"], given))
            applied = run.get("applied", run["input"])[:, place] if kind == "input" else given
            if not np.array_equal(given, applied, equal_nan=True):
                ax.plot(run["t"], applied, "k--", lw=0.8, label=f"{label}: applied")
                curves.append((run["t"], applied))
        ax.set_ylabel(with_unit(symbol(name), unit))
        mark_jumps(ax, first)
        _drop_start(ax, curves)
    axes[-1].set_xlabel("t [s]")
    told = {label: line for ax in axes for line, label in zip(*_legend(ax), strict=True)}
    figure.legend(told.values(), told.keys(), loc="outside lower center", ncols=5)
    figure.suptitle(title)
    return figure


def _legend(ax: Axes) -> tuple[list[Any], list[Any]]:
    lines, labels = ax.get_legend_handles_labels()
    return list(lines), list(labels)


def hidden_states(run: Arrays) -> list[str]:
    """Arrays of the plant's state that hold more than its outputs."""
    shown = [column.tobytes() for column in np.ascontiguousarray(run["output"].T)]
    return [
        name
        for name in run["states"].tolist()
        if any(column.tobytes() not in shown for column in np.ascontiguousarray(run[name].T))
    ]


def traces(run: Arrays, names: Sequence[str], title: str) -> Figure:
    """One draw's arrays by name against time: a row a name, a line an entry."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 0.9 + 2.0 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for ax, name in zip(axes, names, strict=True):
        rows = run[name].reshape(len(run["t"]), -1)
        for entry, column in enumerate(rows.T):
            label = str(entry + 1) if rows.shape[1] > 1 and entry < _IN_LEGEND else None
            ax.plot(run["t"], column, lw=0.8, label=label)
        if rows.shape[1] > 1:
            beside(ax, fontsize="small", title=None if rows.shape[1] <= _IN_LEGEND else "first")
        ax.set_ylabel(symbol(name))
        mark_jumps(ax, run)
    axes[-1].set_xlabel("t [s]")
    figure.suptitle(title)
    return figure


def mark_jumps(ax: Axes, run: Arrays) -> None:
    """Grey lines where a parameter of the plant changed."""
    jumped = np.zeros(len(run["t"]) - 1, bool)
    for name in run["parameters"][:, 0].tolist():
        jumped |= np.any(np.diff(run[name], axis=0) != 0, axis=-1)
    for time in run["t"][1:][jumped]:
        ax.axvline(time, color="0.8", lw=0.6, zorder=0)


def _fit_after_start(ax: Axes, curves: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
    """Scale the axis by what comes after the first peak, which is far larger and says little."""
    late = [np.abs(y[t > 5.0]).max() for t, y in curves if t[-1] > 5.0]
    if late and max(late) > 0:
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
