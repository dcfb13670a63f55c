"""The end of a sweep: one table (CSV, Markdown) and one picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..runs.pictures import save
from ..runs.writing import write_text
from .gather import Run, read_run, same_command
from .table import csv_of, markdown_of

NAME = "sweep"
_MOST_PRINTED = 60


def write_sweep(folder: Path, runs: Sequence[Run], command: str) -> None:
    """`sweep.csv`, `sweep.md` and, if anything was measured, `sweep.png`; then say so."""
    from .joining import write_joined
    from .picture import picture  # matplotlib is for those who draw

    made = same_command(runs)
    table = markdown_of(runs)
    finished = sum(run.finished for run in runs)
    line = f"{finished} of {len(runs)} runs finished; mean and 95 % interval over draws."
    line += _least(runs) if made == "tune" else ""
    write_text(folder / f"{NAME}.csv", csv_of(runs))
    write_text(folder / f"{NAME}.md", f"`{command}`\n\n{table}\n\n{line}\n")
    figure = picture(runs, f"{made}: {len(runs)} runs")
    if figure is not None:
        save(figure, folder / f"{NAME}.png")
    if len(runs) <= _MOST_PRINTED:
        print(f"\n{table}\n")
    files = f"{NAME}.csv, {NAME}.md, {NAME}.png"
    if write_joined(folder, runs, command):
        files += ", rollouts.csv, ensemble.md, histogram.png"
    print(f"{line}\nwritten to {folder}: {files}", flush=True)


def _least(runs: Sequence[Run]) -> str:
    """Which run ended lowest: of restarts, the one to take."""
    found = {run.name: run.metrics["objective"].mean for run in runs if "objective" in run.metrics}
    found = {name: value for name, value in found.items() if math.isfinite(value)}
    if not found:
        return ""
    name = min(found, key=lambda name: found[name])
    return f" Least objective: run {name} ({found[name]:.4g})."


def end_of_sweep(folder: Path, configurations: Sequence[Any], command: str) -> int:
    """Write what has become of all jobs, run or not; how many of them failed."""
    runs = [read_run(folder / str(n), str(n), cfg) for n, cfg in enumerate(configurations)]
    write_sweep(folder, runs, command)
    return sum(run.status.startswith("failed") for run in runs)
