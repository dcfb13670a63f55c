"""Many runs as one table: the settings that differ, the metrics, how each run ended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..runs.intervals import Interval
from ..runs.writing import aligned, csv_text
from .gather import Run, differing
from .measures import NOTHING


def metric_names(runs: Sequence[Run]) -> list[str]:
    """Metrics that some run has a value of, the leading one first."""
    names = dict.fromkeys(name for run in runs for name in run.metrics)
    return [n for n in names if any(not math.isnan(r.metrics.get(n, NOTHING).mean) for r in runs)]


def csv_of(runs: Sequence[Run]) -> str:
    """All digits; empty where there is no value."""
    settings, names = differing(runs), metric_names(runs)
    header = ["run", *settings]
    for name in names:
        header += [name, f"{name}_half"]
    rows: list[list[object]] = [[*header, "status"]]
    for place, run in enumerate(runs):
        row: list[object] = [run.name, *(_plain(values[place]) for values in settings.values())]
        for name in names:
            found = run.metrics.get(name, NOTHING)
            row += [_digits(found.mean), _digits(found.half)]
        rows.append([*row, run.status])
    return csv_text(rows)


def markdown_of(runs: Sequence[Run]) -> str:
    """Four digits, means with their 95 % intervals."""
    settings, names = differing(runs), metric_names(runs)
    body = [["run", *settings, *names, "status"]]
    for place, run in enumerate(runs):
        row = [run.name, *(_plain(values[place]) for values in settings.values())]
        row += [shown(run.metrics.get(name, NOTHING)) for name in names]
        body.append([text.replace("|", "\\|") for text in [*row, run.status]])
    return aligned(body)


def shown(found: Interval) -> str:
    """`0.06128 ± 0.00012`, the interval to the mean's last digit."""
    if math.isnan(found.mean):
        return "-"
    if math.isnan(found.half):
        return f"{found.mean:.4g}"
    size = max(abs(found.mean), found.half)
    digits = max(0, 3 - math.floor(math.log10(size))) if 0 < size < math.inf else 0
    return f"{found.mean:.{digits}f} ± {found.half:.{digits}f}"


def _plain(value: Any) -> str:
    return "null" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _digits(value: float) -> str:
    return "" if math.isnan(value) else repr(value)
