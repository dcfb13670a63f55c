"""What the ablation leaves behind: a table each, one record, one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..learning.figures import MORE_COLOURS
from ..learning.report import Comparison, Measure, Report, compare
from ..settings.ablation_config import AblationConfig
from .part import Part

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Parts by table and variant.
Found = Mapping[str, Mapping[str, Part]]
MEASURES: dict[str, tuple[Measure, ...]] = {
    "online": (
        Measure("after_switch", "RMSE after a return", 3),
        Measure("steady", "RMSE, steady", 3),
        Measure("before_return", "RMSE before return", 3),
    ),
    "arm": (
        Measure("after_return", "RMS error after a return [mrad]", 2),
        Measure("first_visit", "first visit [mrad]", 1),
        Measure("steady", "steady [mrad]", 2),
        Measure("whole", "all the time [mrad]", 2),
        Measure("input_rate", "RMS input rate [N m/s]", 0),
    ),
    "recall": (
        Measure("score", "accuracy", 2, lower_is_better=False),
        Measure("best_iterations", "to its best [iterations]", 0),
        Measure("training_s", "training [s]", 1),
    ),
}
TITLES = {
    "online": ("t [s]", "RMSE over seeds [-]"),
    "arm": ("t [s]", "RMS error over draws [mrad]"),
    "recall": ("iterations", "accuracy, mean over seeds"),
}


def described(cfg: AblationConfig, table: str) -> str:
    """What a table shows."""
    online, arm, recall = cfg.online, cfg.arm, cfg.recall
    return {
        "online": (
            f"Three functions in turn, {online.visits} visits of {online.visit_length:g} s each, "
            f"{online.seeds} seeds. After a return: the first 1 s. Before return: on a function's "
            "points just before it comes back, of readouts the best slot. memory_S: the paper's, "
            "hard attention. wiped: readouts start anew at every change. Rate: the best of "
            f"{', '.join(f'{rate:g}' for rate in online.rates)} after a return, on other streams; "
            f"sharpness {cfg.online_sharpness:g}."
        ),
        "arm": (
            f"{arm.n_regimes} payloads up to {arm.payload:g} kg in random order, {arm.visits} "
            f"visits of {arm.visit_length:g} s each, {arm.draws} draws; C_w = C_v = {arm.rate:g}. "
            f"After a return: the first {arm.window:g} s. readouts_1 is the plain network with "
            f"twice its C_w. Input rate: at the solver's step of {arm.dt:g} s, noise held for 10 "
            f"ms and all; sharpness {cfg.arm_sharpness:g}."
        ),
        "recall": (
            f"As in `peers`, at most {recall.iterations} iterations, {recall.seeds} seeds; each "
            "cell has as many parameters as `memory`, by its size."
        ),
    }[table]


def compared(found: Mapping[str, Part], table: str) -> Comparison:
    """One table, judged against its first variant."""
    base = next(iter(found))
    names = list(next(iter(found.values())).told)
    extra: dict[str, dict[str, object]] = {
        name: {v: _number(part.told[name]) for v, part in found.items()} for name in names
    }
    measures = {variant: part.measures for variant, part in found.items()}
    return compare(MEASURES[table], measures, {v: base for v in found if v != base}, extra)


def _number(value: np.ndarray) -> object:
    number = float(value)
    return int(number) if number.is_integer() else round(number, 3)


def reported(cfg: AblationConfig, found: Found, wall_s: float) -> Report:
    """Tables, record and arrays."""
    texts: list[str] = []
    rows: list[list[object]] = []
    arrays: dict[str, np.ndarray] = {}
    tables: dict[str, Sequence[Sequence[object]]] = {}
    for table, parts in found.items():
        one = compared(parts, table)
        texts += [f"### {table}", described(cfg, table), one.markdown]
        tables[table] = [one.header, *one.rows]
        at = [one.header.index(f"{measure.name}_half") - 1 for measure in MEASURES[table]]
        for row in one.rows:
            for measure, place in zip(MEASURES[table], at, strict=True):
                rows.append([table, row[0], measure.name, *row[place : place + 3]])
        for variant, part in parts.items():
            kept = {**part.measures, **part.told, "curve": part.curve, "at": part.at}
            arrays |= {f"{table}/{variant}/{name}": value for name, value in kept.items()}
    header = ["task", "variant", "measure", "value", "value_half", "value_verdict"]
    note = (
        "Mean and 95 % interval. Better, worse: than the first of a table, paired by seed or draw, "
        f"at 95 %, not corrected for their number. Readouts: recall time {cfg.recall_time:g} s."
    )
    curves = {f"{t}/{v}": part.curve for t, parts in found.items() for v, part in parts.items()}
    return Report(
        Comparison(header, rows, "\n\n".join(texts)), note, {"wall_s": wall_s}, arrays, curves,
        tables,
    )  # fmt: skip


def picture(found: Found) -> Figure:
    """A table each: error over time, accuracy over iterations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.2 * len(found)), layout="constrained")
    rows = figure.subplots(len(found), 1, squeeze=False)[:, 0]
    for ax, (table, parts) in zip(rows, found.items(), strict=True):
        for colour, (variant, part) in zip(MORE_COLOURS, parts.items(), strict=False):
            ax.plot(part.at, part.curve, lw=1.0, color=colour, label=variant)
        if table != "recall":
            ax.set_yscale("log")
        ax.set_xlabel(TITLES[table][0])
        ax.set_ylabel(TITLES[table][1])
        ax.set_title(table)
        ax.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.suptitle("The memory less one part each")
    return figure
