"""What a learning experiment leaves behind: table, record, arrays, figures, TensorBoard."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from torch.utils.tensorboard import SummaryWriter

from mann_torch.errors import ConfigError
from mann_torch.memory import MemoryTrace, reallocation_log
from mann_torch.statistics import mean_and_half

from .figures import save
from .recording import MAX_POINTS, flat_settings, log_summary
from .writing import csv_text, write_arrays, write_json, write_text


def check_at_least(cfg: Any, limits: Mapping[str, int]) -> None:
    """Raise `ConfigError` for a setting below its least value."""
    for name, least in limits.items():
        if getattr(cfg, name) < least:
            raise ConfigError(f"{name} = {getattr(cfg, name)}: at least {least}")


def check_positive(cfg: Any, names: Sequence[str]) -> None:
    """Raise `ConfigError` for a setting that is not finite and > 0."""
    for name in names:
        value = getattr(cfg, name)
        if not (math.isfinite(value) and value > 0):
            raise ConfigError(f"{name} = {value}: must be finite and > 0")


def check_variants(chosen: Sequence[str], known: Sequence[str]) -> None:
    """Raise `ConfigError` for no variant, an unknown one or one twice."""
    for name in chosen:
        if name not in known:
            raise ConfigError(f"unknown variant '{name}'; choose from {', '.join(known)}")
    if not chosen or len(set(chosen)) < len(chosen):
        raise ConfigError(f"variants = {list(chosen)}: name each once, at least one")


def interval(values: np.ndarray) -> tuple[float, float]:
    """Mean and 95 % half-width over seeds; NaN (never, diverged) makes both NaN."""
    mean, half = mean_and_half(torch.as_tensor(values, dtype=torch.float64))
    return float(mean), float(half)


def shown(mean: float, half: float, digits: int) -> str:
    """`0.350 ± 0.040`."""
    spread = "" if math.isnan(half) else f" ± {half:.{digits}f}"
    return f"{mean:.{digits}f}{spread}"


def verdict(values: np.ndarray, base: np.ndarray, lower_is_better: bool) -> str:
    """Paired by seed against a baseline: `better`, `worse` or `no difference` at 95 %."""
    mean, half = interval(values - base)
    if math.isnan(half):
        return "too few seeds to tell"
    if abs(mean) <= half:
        return "no difference"
    return "better" if (mean < 0) == lower_is_better else "worse"


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def trace_arrays(traces: Mapping[str, MemoryTrace], *member: int) -> dict[str, np.ndarray]:
    """One batch member's attention, contents and reallocation log, `variant/name` each."""
    found: dict[str, np.ndarray] = {}
    for variant, trace in traces.items():
        found |= {f"{variant}/{name}": array for name, array in trace.member(*member).items()}
        log = reallocation_log(trace, *member)
        found |= {f"{variant}/reallocation_{name}": array for name, array in log.items()}
    return found


def write_all(
    folder: Path,
    cfg: Any,
    record: Mapping[str, Any],
    header: Sequence[str],
    rows: Sequence[Sequence[object]],
    report: str,
    arrays: Mapping[str, np.ndarray],
    figures: Mapping[str, Figure],
    scalars: Mapping[str, np.ndarray],
) -> None:
    """Everything of a run; `scalars` (T,) become TensorBoard curves, by tag."""
    write_text(folder / "table.csv", csv_text([header, *rows]))
    write_text(folder / "report.md", report)
    write_arrays(folder / "arrays.npz", arrays)
    for name, figure in figures.items():
        save(figure, folder / f"{name}.png")
    if cfg.tensorboard:
        with SummaryWriter(str(folder)) as writer:
            for tag, values in scalars.items():
                stride = -(-len(values) // MAX_POINTS)
                for step in range(0, len(values), stride):
                    writer.add_scalar(tag, float(values[step]), step)
            results = {f"result/{row[0]}/{header[1]}": float(str(row[1])) for row in rows}
            log_summary(writer, flat_settings(asdict(cfg)), results, figures)
    write_json(folder / "metrics.json", record)
