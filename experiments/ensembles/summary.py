"""What many rollouts came to: mean, quantiles, and the worst, each to be run again alone."""

from __future__ import annotations

import shlex

import numpy as np

from ..runs.figures import with_unit
from ..runs.intervals import interval
from ..runs.writing import aligned
from .rollouts import Rollouts

Statistics = dict[str, float]
QUANTILES = {"q05": 0.05, "median": 0.5, "q95": 0.95, "q99": 0.99}
_WORST = 10


def measures(rollouts: Rollouts) -> dict[str, np.ndarray]:
    """Columns by name, the leading one first."""
    counts = {name: getattr(rollouts, name) for name in ("reallocations", "switches")}
    return rollouts.errors() | counts


def statistics(rollouts: Rollouts) -> dict[str, Statistics]:
    """Of each measure over the rollouts that came to their end; NaN where there is none."""
    return {name: _of(column[rollouts.ok]) for name, column in measures(rollouts).items()}


def _of(values: np.ndarray) -> Statistics:
    values = values[np.isfinite(values)].astype(float)
    names = ("mean", "half", "sd", "least", *QUANTILES, "most")
    if not len(values):
        return dict.fromkeys(names, float("nan"))
    mean = interval(values)
    found = [mean.mean, mean.half, values.std(ddof=1) if len(values) > 1 else np.nan, values.min()]
    found += [*np.quantile(values, list(QUANTILES.values())), values.max()]
    return dict(zip(names, map(float, found), strict=True))


def table(rollouts: Rollouts) -> str:
    """Their statistics in Markdown, SRMSE x 10^3 as the paper prints it."""
    units = dict(zip(rollouts.errors(), rollouts.outputs[:, 1].tolist() * 2, strict=True))
    shares = [f"{100 * share:g} %" for share in QUANTILES.values()]
    body = [["", "mean", "standard deviation", "least", *shares, "most"]]
    for name, values in statistics(rollouts).items():
        of_error = name in units
        scale, digits = (1e3, 4) if of_error else (1.0, 2)
        told = {key: f"{scale * value:.{digits}f}" for key, value in values.items()}
        head = with_unit(f"{name} x 10^3", units[name]) if of_error else name
        mean = told["mean"] + ("" if np.isnan(values["half"]) else f" ± {told['half']}")
        body.append([head, mean, *(told[k] for k in ("sd", "least", *QUANTILES, "most"))])
    return aligned(body)


def worst(rollouts: Rollouts) -> list[int]:
    """Rows of those that diverged, then of the largest SRMSE over all outputs, ten at most."""
    size = np.sqrt(np.square(rollouts.srmse).sum(axis=1))
    size = np.where(rollouts.ok, size, np.inf)
    return [int(row) for row in np.argsort(-size, kind="stable")[:_WORST]]


def worst_table(rollouts: Rollouts, draw: int) -> str:
    """The worst with the overrides that run each of them alone; `draw` is that of rollout 0."""
    body = [["rollout", f"SRMSE x 10^3 of {', '.join(rollouts.names)}", "status", "overrides"]]
    for row in worst(rollouts):
        errors = ", ".join(f"{1e3 * value:.4f}" for value in rollouts.srmse[row])
        own = [f"initial.draw={draw + int(rollouts.number[row])}", *_parameters(rollouts, row)]
        told = str(rollouts.status[row]).replace("|", "\\|")
        body.append([str(rollouts.number[row]), errors, told, f"`{shlex.join(own)}`"])
    return aligned(body)


def _parameters(rollouts: Rollouts, row: int) -> list[str]:
    """Overrides of the plant's parameters that are a rollout's own."""
    own: dict[str, list[float]] = {}
    for entry, value in zip(rollouts.entries.tolist(), rollouts.drawn[row].tolist(), strict=True):
        own.setdefault(entry.rpartition("_")[0], []).append(value)
    return [f"plant.{name}=[{','.join(map(repr, values))}]" for name, values in own.items()]


def ranges(numbers: np.ndarray) -> str:
    """`0 to 4999, 7500 to 9999`."""
    pieces = np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1)
    return ", ".join(f"{p[0]} to {p[-1]}" if len(p) > 1 else str(p[0]) for p in pieces)
