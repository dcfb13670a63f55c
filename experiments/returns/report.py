"""What controllers made of regimes that return: a table, paired by draw, and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..learning.figures import MORE_COLOURS
from ..learning.report import Measure, Report, compare, interval
from ..settings.returning_config import ReturningConfig
from .ways import Found

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def measures_of(cfg: ReturningConfig) -> list[Measure]:
    """First visits, each return, all of the time, and what the input costs."""
    returns = [f"return_{k}" for k in range(1, cfg.visits)]
    named = [("first_visit", "first visit"), *((name, name.replace("_", " ")) for name in returns)]
    found = [Measure(name, f"RMS error, {title} [mrad]", 1) for name, title in named]
    found.append(Measure("whole", "RMS error, all the time [mrad]", 1))
    return [*found, Measure("input_rate", "RMS input rate [rad/s^3]", 2)]


def by_visit(cfg: ReturningConfig, found: Found, first: int = 0) -> np.ndarray:
    """RMS error after a change, a row a visit of regimes from `first` on (visits, draws) [mrad]."""
    turns = found.after.reshape(cfg.visits, cfg.n_regimes, -1)[:, first:]
    mean: np.ndarray = 1e3 * np.sqrt((turns**2).mean(axis=1))
    return mean


def reported(cfg: ReturningConfig, found: Mapping[str, Found], wall_s: float) -> Report:
    """Each variant beside the first, and each return beside the first visit."""
    measures, gains = {}, {}
    names = [measure.name for measure in measures_of(cfg)]
    for variant, one in found.items():
        visits, later = by_visit(cfg, one), by_visit(cfg, one, first=1)
        columns = [*visits, 1e3 * one.whole, one.rate]
        measures[variant] = dict(zip(names, columns, strict=True))
        mean, half = interval(100.0 * (later[-1] / later[0] - 1.0))
        gains[variant] = f"{mean:+.1f} ± {half:.1f} %"
    extra = {
        "last return against first visit": gains,
        "tuned to": {v: _constants(one) for v, one in found.items()},
    }
    base = next(iter(found))
    baselines = {variant: base for variant in found if variant != base}
    note = (
        f"{cfg.n_regimes} regimes of wing rock in turn, {cfg.visits} visits of "
        f"{cfg.visit_length:g} s to each, {cfg.draws} draws of regimes, reference and noise. RMS "
        f"error in the first {cfg.window:g} s of a visit; mean and 95 % interval over draws. "
        f"Better, worse: paired by draw against {base}, at 95 %, not corrected for their number. A "
        "controller that remembers would have less error at a return than at a first visit (last "
        "against first, by draw, of the regimes that were entered from another one). Tuned "
        f"ones: on {cfg.training} other draws, {cfg.iterations} iterations, for error after "
        f"returns at no more input rate than {base}'s."
    )
    rows: list[list[object]] = [["variant", *(f"visit_{v + 1}" for v in range(len(one.after)))]]
    rows += [[v, *np.nanmean(found[v].after, axis=1).tolist()] for v in found]
    arrays = {
        f"{v}/{name}": value
        for v, one in found.items()
        for name, value in (
            *(("after", one.after), ("whole", one.whole), ("rate", one.rate)),
            *((f"constants/{name}", value) for name, value in one.constants.items()),
        )
    }
    return Report(
        compare(measures_of(cfg), measures, baselines, extra),
        note,
        {"wall_s": wall_s},
        arrays,
        {f"{v}/rms_error": one.error for v, one in found.items()},
        {"visits": rows},
    )


def _constants(found: Found) -> str:
    return ", ".join(f"{n} {float(value):.3g}" for n, value in found.constants.items()) or "-"


def picture(cfg: ReturningConfig, found: Mapping[str, Found]) -> Figure:
    """Error after each change, visit by visit, with its interval over draws."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for n, (colour, (name, one)) in enumerate(zip(MORE_COLOURS, found.items(), strict=False)):
        t = 0.25 * cfg.window * (np.arange(len(one.error)) + 0.5)
        left.semilogy(t, 1e3 * one.error, lw=1.0, color=colour, label=name)
        rows = [interval(row) for row in by_visit(cfg, one)]
        x = np.arange(len(rows)) + 0.06 * (n - len(found) / 2)
        mean, half = np.array(rows).T
        right.errorbar(x, mean, half, fmt="o-", ms=4, lw=1.0, capsize=2, color=colour)
    for visit in range(1, cfg.n_regimes * cfg.visits):
        left.axvline(visit * cfg.visit_length, color="0.6", lw=0.7, ls=":", zorder=0)
    left.set_xlabel("t [s]; dotted: the regime changes")
    left.set_ylabel("RMS error over draws [mrad]")
    labels = ["first", *(f"return {k}" for k in range(1, cfg.visits))]
    right.set_xticks(range(cfg.visits), labels)
    right.set_yscale("log")
    right.set_ylabel(f"RMS error in the first {cfg.window:g} s of a visit [mrad]")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle("Regimes of wing rock that return")
    return figure
