"""What a learning experiment leaves behind: table, record, arrays, figures, TensorBoard."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch

from mann_torch.memory import MemoryTrace, reallocation_log
from mann_torch.statistics import mean_and_half

from ..records.recording import MAX_POINTS, log_summary, summary_writer, telling_settings
from ..runs.life import finish
from ..runs.pictures import save_all
from ..runs.writing import csv_text, write_arrays, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Measure(NamedTuple):
    """A column of a comparison."""

    name: str
    title: str
    digits: int
    lower_is_better: bool = True


class Comparison(NamedTuple):
    """Variants by measures, each judged against its baseline."""

    header: list[str]
    rows: list[list[object]]
    markdown: str


class Report(NamedTuple):
    """All of a run's results; `curves` (T,) go to TensorBoard, `tables` to CSV, by name."""

    comparison: Comparison
    note: str
    record: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray]
    curves: Mapping[str, np.ndarray]
    tables: Mapping[str, Sequence[Sequence[object]]]


def interval(values: np.ndarray) -> tuple[float, float]:
    """Mean and 95 % half-width over seeds; NaN (never, diverged) makes both NaN."""
    mean, half = mean_and_half(torch.as_tensor(values, dtype=torch.float64))
    return float(mean), float(half)


def verdict(values: np.ndarray, base: np.ndarray, lower_is_better: bool) -> str:
    """Paired by seed against a baseline, at 95 %: `better`, `worse`, `no difference`.

    `diverged` where a seed of either has no finite value.
    """
    if not np.isfinite(values - base).all():
        return "diverged"
    mean, half = interval(values - base)
    if math.isnan(half):
        return "too few seeds to tell"
    if abs(mean) <= half:
        return "no difference"
    return "better" if (mean < 0) == lower_is_better else "worse"


def shown(values: np.ndarray, digits: int) -> str:
    """`0.350 ± 0.040`, or how many seeds diverged."""
    lost = int((~np.isfinite(values)).sum())
    if lost:
        return f"diverged ({lost} of {len(values)} seeds)"
    mean, half = interval(values)
    return f"{mean:.{digits}f}" + ("" if math.isnan(half) else f" ± {half:.{digits}f}")


def compare(
    measures: Sequence[Measure],
    found: Mapping[str, Mapping[str, np.ndarray]],
    baselines: Mapping[str, str],
    extra: Mapping[str, Mapping[str, object]],
) -> Comparison:
    """A table of `found[variant][measure]` (seeds,), after columns `extra[title][variant]`."""
    header = ["variant", *extra]
    for measure in measures:
        header += [measure.name, f"{measure.name}_half", f"{measure.name}_verdict"]
    titles = ["variant", *extra, *(measure.title for measure in measures)]
    rows: list[list[object]] = []
    lines = []
    for variant, values in found.items():
        row: list[object] = [variant, *(column[variant] for column in extra.values())]
        line = [str(entry) for entry in row]
        base = found.get(baselines.get(variant, ""))
        for measure in measures:
            mine = values[measure.name]
            said = verdict(mine, base[measure.name], measure.lower_is_better) if base else ""
            row += [*interval(mine), said]
            mark = f" {said}" if said in ("better", "worse") else ""
            line.append(shown(mine, measure.digits) + mark)
        rows.append(row)
        lines.append(line)
    return Comparison(header, rows, markdown(titles, lines))


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def member_arrays(trace: MemoryTrace, *member: int) -> dict[str, np.ndarray]:
    """One batch member's attention, contents and reallocation log, by name."""
    log = reallocation_log(trace, *member)
    return trace.member(*member) | {f"reallocation_{name}": a for name, a in log.items()}


def by_variant(runs: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """`variant/name` arrays of nested ones."""
    return {f"{v}/{name}": array for v, run in runs.items() for name, array in run.items()}


def write_report(folder: Path, command: str, report: Report) -> None:
    """Table, record and arrays: all that was computed, before any picture is drawn."""
    table = report.comparison
    write_text(folder / "table.csv", csv_text([table.header, *table.rows]))
    for name, rows in report.tables.items():
        write_text(folder / f"{name}.csv", csv_text(rows))
    write_text(folder / "report.md", f"`{command}`\n\n{table.markdown}\n\n{report.note}\n")
    write_arrays(folder / "arrays.npz", report.arrays)


def conclude(
    folder: Path, cfg: Any, command: str, report: Report, draw: Callable[[], dict[str, Figure]]
) -> None:
    """Everything on disk, pictures where they are wanted, the completion mark last."""
    write_report(folder, command, report)
    write_pictures(folder, cfg, command, report, draw() if cfg.output.figures else {})
    table = report.comparison
    records = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    finish(folder, {**report.record, "table": records, "command": command})
    print(f"{table.markdown}\n\n{report.note}")
    print(f"{report.record['wall_s']:.0f} s in all\nwritten to {folder}", flush=True)


def write_pictures(
    folder: Path, cfg: Any, command: str, report: Report, figures: Mapping[str, Figure]
) -> None:
    """Files, and TensorBoard's curves, figures and results."""
    save_all(folder, figures, cfg.output)
    if not cfg.output.tensorboard:
        return
    measure = next(
        name for name in report.comparison.header if name + "_half" in report.comparison.header
    )
    place = report.comparison.header.index(measure)
    with summary_writer(folder, command) as writer:
        for tag, values in report.curves.items():
            stride = -(-len(values) // MAX_POINTS)
            for step in range(0, len(values), stride):
                writer.add_scalar(tag, float(values[step]), step)
        results = {}
        for row in report.comparison.rows:
            whose = "/".join(map(str, row[: report.comparison.header.index("variant") + 1]))
            results[f"result/{whose}/{measure}"] = float(str(row[place]))
        log_summary(writer, telling_settings(cfg), results, figures)
