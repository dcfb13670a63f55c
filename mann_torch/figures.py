"""A memory at work as a picture: one batch member's attention, contents and resets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .checks import named, text, wrong
from .errors import ConfigError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3  # memories side by side, at most


def memory_figure(
    runs: Mapping[str, Mapping[str, np.ndarray]],
    t: np.ndarray | None = None,
    title: str = "",
    marks: Sequence[float] = (),
    t_label: str = "step",
) -> Figure:
    """Attention over time, resets in red, and below it every slot's contents as a heat map.

    `runs` are arrays (T, .) by name, as `MemoryTrace.member` gives them: `weights`, `mu`, and where
    there are any `reset`, and `valid`: steps that were not taken are left blank. `t` (T,) are their
    times, 0, 1, 2 ... if not given; `marks` times at which the task changed. For TensorBoard:
    `writer.add_figure("memory", memory_figure({"cell": member}))`.

    Raises `ConfigError` for no run or one without its arrays, `KindError`.

    >>> import torch
    >>> from mann_torch.memory import MemoryCell, MemorySequence
    >>> trace = MemorySequence(MemoryCell(3, 8)).trace(torch.zeros(7, 2, 3))
    >>> len(memory_figure({"second": trace.member(1)}).axes)
    4
    """
    named("runs", runs, Mapping, 'a run\'s arrays by name: {"name": trace.member(i)}')
    if not runs or not all({"weights", "mu"} <= set(run) for run in runs.values()):
        raise ConfigError("runs: give at least one, each with `weights` and `mu`")
    for key, run in runs.items():
        for name in ("weights", "mu", "reset", "valid"):
            if name in run and not isinstance(run[name], np.ndarray):
                raise wrong(f"runs[{key!r}][{name!r}]", run[name], "an array")
    t = None if t is None else _numbers("t", t)
    lines = _numbers("marks", marks).tolist()
    title, t_label = text("title", title), text("t_label", t_label)
    blocks = -(-len(runs) // COLUMNS)
    columns = -(-len(runs) // blocks)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(max(8.0, 5.2 * columns), 5.2 * blocks + 0.4), layout="constrained")
    axes = figure.subplots(2 * blocks, columns, squeeze=False, height_ratios=(1, 2) * blocks)
    for place, (name, run) in enumerate(runs.items()):
        block, column = divmod(place, columns)
        top, bottom = axes[2 * block][column], axes[2 * block + 1][column]
        when = np.arange(len(run["weights"])) if t is None else t
        _attention(top, run, when, name)
        _contents(bottom, run, when)
        bottom.set_xlabel(t_label)
        for ax in (top, bottom):
            for mark in lines:
                ax.axvline(mark, color="0.3", lw=0.5, ls=":")
    for place in range(len(runs), blocks * columns):
        block, column = divmod(place, columns)
        axes[2 * block][column].remove()
        axes[2 * block + 1][column].remove()
    figure.suptitle(title)
    return figure


def _numbers(name: str, given: object) -> np.ndarray:
    """A row of numbers as an array. Raises `KindError`."""
    row = np.asarray(given)
    if row.ndim != 1 or (len(row) and row.dtype.kind not in "fiu"):
        raise wrong(name, given, "a row of numbers")
    return row


def _attention(ax: Axes, run: Mapping[str, np.ndarray], t: np.ndarray, name: str) -> None:
    _map(ax, _rows(run, "weights"), t, run["weights"].shape[-1], "Blues", "$w_r$", (0.0, 1.0))
    if "reset" in run:
        at = np.flatnonzero(run["reset"] >= 0)
        size = 5.0 if len(at) < 50 else 2.0
        ax.plot(t[at], run["reset"][at] + 1, "o", color="tab:red", ms=size, mew=0)
    title = "attention, resets in red" if "reset" in run else "attention"
    ax.set_title(f"{name}: {title}", fontsize="medium")
    ax.set_ylabel("slot")


def _contents(ax: Axes, run: Mapping[str, np.ndarray], t: np.ndarray) -> None:
    n_slots, width = run["mu"].shape[-2:]
    _map(ax, _rows(run, "mu"), t, n_slots, "viridis", r"$\mu$")
    for edge in range(1, n_slots):
        ax.axhline(edge + 0.5, color="w", lw=0.8)
    ax.set_ylabel(rf"slot: $\mu_i$, {width} numbers each")


def _rows(run: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """A signal as numbers (T, rows), NaN where no step was taken."""
    rows = run[name].reshape(len(run[name]), -1)
    return np.where(run["valid"][:, None], rows, np.nan) if "valid" in run else rows


def _map(
    ax: Axes,
    values: np.ndarray,
    t: np.ndarray,
    n_slots: int,
    colours: str,
    label: str,
    limits: tuple[float, float] | None = None,
) -> None:
    """Values (T, rows) as an image over t, its rows spread over the slots 1 ... S."""
    half = 0.5 * (t[1] - t[0]) if len(t) > 1 else 0.5
    image = ax.imshow(
        values.T,
        aspect="auto",
        origin="lower",
        interpolation="nearest",
        cmap=colours,
        vmin=limits and limits[0],
        vmax=limits and limits[1],
        extent=(t[0] - half, t[-1] + half, 0.5, n_slots + 0.5),
    )
    ax.figure.colorbar(image, ax=ax, label=label)
    ax.set_yticks(range(1, n_slots + 1))
