"""The paper's tables beside ours: cells with verdicts, reductions, paired differences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ..runs.intervals import Interval
from ..runs.writing import aligned
from ..settings.config import TableConfig
from .claim_runs import OURS
from .results import Results

VERDICTS = ("within 5 %", "within 10 %", "off")
#: The paper prints this many distinct figures; so many are to be met within 10 % and 5 %.
ALL_FIGURES, TARGET = 46, (44, 30)


@dataclass(frozen=True)
class Cell:
    """One figure: a controller, a joint, what the paper prints and what we get."""

    table: str
    label: str
    scenario: str
    variant: str
    metric: str
    joint: int
    paper: float | None  # SRMSE x 10^3
    mean: float
    sd: float  # over draws; NaN for one draw
    paired: Interval | None  # difference from this paper's controller over the same draws

    @property
    def identity(self) -> tuple[str, str, str, int]:
        """Equal for cells that print the same figure again."""
        return (self.scenario, self.variant, self.metric, self.joint)

    @property
    def difference(self) -> float:
        """Ours against the paper [%]; NaN where the paper prints nothing."""
        return math.nan if self.paper is None else 100.0 * (self.mean / self.paper - 1.0)

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`, or empty where the paper prints nothing."""
        if self.paper is None:
            return ""
        off = abs(self.difference)
        return VERDICTS[0] if off <= 5.0 else VERDICTS[1] if off <= 10.0 else VERDICTS[2]


def cells(table: TableConfig, results: Results) -> list[Cell]:
    """All figures of a table, row by row, joint 1 then joint 2."""
    found = []
    for row in table.rows:
        scenario = row.scenario or table.scenario
        values = results.srmse(scenario, row.variant, table.metric)
        for joint in range(2):
            draws = values[:, joint]
            paired = None
            if row.variant != OURS:
                paired = results.change(scenario, row.variant, OURS, joint, table.metric)
            found.append(
                Cell(
                    table=table.title,
                    label=row.label,
                    scenario=scenario,
                    variant=row.variant,
                    metric=table.metric,
                    joint=joint + 1,
                    paper=None if row.paper is None else row.paper[joint],
                    mean=float(draws.mean()),
                    sd=float(draws.std(ddof=1)) if len(draws) > 1 else math.nan,
                    paired=paired,
                )
            )
    return found


def published(all_cells: Iterable[Cell]) -> list[Cell]:
    """The distinct figures that the paper prints."""
    distinct: dict[tuple[str, str, str, int], Cell] = {}
    for cell in all_cells:
        if cell.paper is not None:
            distinct.setdefault(cell.identity, cell)
    return list(distinct.values())


def counts(all_cells: Iterable[Cell]) -> tuple[int, int, int]:
    """Published figures in all, and those met within 10 % and within 5 %."""
    verdicts = [cell.verdict for cell in published(all_cells)]
    return len(verdicts), len(verdicts) - verdicts.count("off"), verdicts.count(VERDICTS[0])


def score(all_cells: Iterable[Cell]) -> str:
    """How many published figures are met, in one line; for all 46, whether the target is."""
    total, fair, close = counts(all_cells)
    line = f"{total} published figures: {fair} within 10 %, {close} within 5 %, {total - fair} off"
    if total < ALL_FIGURES:
        return line
    met = fair >= TARGET[0] and close >= TARGET[1]
    return f"{line}; target {TARGET[0]} and {TARGET[1]}: {'met' if met else 'missed'}"


def reductions(table: TableConfig, results: Results) -> list[tuple[float, float, Interval]]:
    """Per joint: the paper's % reduction from I to II, ours, and the paired change of II.

    Ours is taken from the means over draws; the interval is over paired draws. Empty for a table
    that compares nothing.
    """
    if table.reduction is None:
        return []
    by_label = {row.label: row for row in table.rows}
    one, two = (by_label[label] for label in table.reduction)
    rows = []
    for joint in range(2):
        change = results.change(
            two.scenario or table.scenario, two.variant, one.variant, joint, table.metric
        )
        printed = math.nan if table.paper_reduction is None else table.paper_reduction[joint]
        rows.append((printed, -change.mean, change))
    return rows


def markdown(table: TableConfig, results: Results) -> str:
    """One table as Markdown."""
    lines = [
        f"### {table.title}",
        "",
        "SRMSE x 10^3 [rad], mean ± standard deviation over draws. Paired: mean difference from "
        "this paper's controller over the same draws ± half of its 95 % interval.",
        "",
    ]
    body = [["controller", "joint", "paper", "ours", "difference", "verdict", "paired, from II"]]
    for cell in cells(table, results):
        body.append(
            [
                cell.label,
                str(cell.joint),
                "-" if cell.paper is None else f"{cell.paper:g}",
                f"{cell.mean:.2f}" + ("" if math.isnan(cell.sd) else f" ± {cell.sd:.2f}"),
                "-" if cell.paper is None else f"{cell.difference:+.1f} %",
                cell.verdict or "-",
                "-" if cell.paired is None else str(cell.paired),
            ]
        )
    for joint, (printed, ours, change) in enumerate(reductions(table, results), start=1):
        body.append(
            [
                "% reduction from I to II",
                str(joint),
                f"{printed:g} %",
                f"{ours:.1f} %",
                "",
                "",
                f"II from I: {change}" + ("" if change.excludes_zero else ", includes 0"),
            ]
        )
    return "\n".join([*lines, aligned(body)])


def cell_rows(all_cells: Iterable[Cell]) -> list[list[object]]:
    """Every cell, under a head, for a CSV file; SRMSE x 10^3."""
    rows: list[list[object]] = [
        [
            *("table", "controller", "scenario", "variant", "metric", "joint", "verdict"),
            *("paper", "mean", "sd", "difference_percent"),
            *("paired_change_percent", "half_of_95_percent_interval"),
        ]
    ]
    for c in all_cells:
        pair = c.paired or Interval(math.nan, math.nan)
        numbers = [c.paper, c.mean, c.sd, c.difference, pair.mean, pair.half]
        shown = ["" if x is None or math.isnan(x) else f"{x:.6g}" for x in numbers]
        rows.append([c.table, c.label, c.scenario, c.variant, c.metric, c.joint, c.verdict, *shown])
    return rows


def reduction_rows(all_tables: Mapping[str, TableConfig], results: Results) -> list[list[object]]:
    """The % reductions and paired differences of all tables, under a head, for a CSV file."""
    rows: list[list[object]] = [
        [
            *("table", "joint", "paper_reduction_percent", "reduction_percent"),
            *("paired_change_percent", "half_of_95_percent_interval"),
        ]
    ]
    for table in all_tables.values():
        for joint, (printed, ours, change) in enumerate(reductions(table, results), start=1):
            numbers = [printed, ours, change.mean, change.half]
            shown = ["" if math.isnan(x) else f"{x:.6g}" for x in numbers]
            rows.append([table.title, joint, *shown])
    return rows


def slots_table(table_cells: Iterable[Cell]) -> np.ndarray:
    """Means of the one-slot baseline over the paper's controller, per table and joint."""
    pairs: dict[tuple[str, str, int], dict[str, float]] = {}
    for cell in table_cells:
        pairs.setdefault((cell.table, cell.scenario, cell.joint), {})[cell.variant] = cell.mean
    ratios = [p["one_slot"] / p["reallocating_initial"] for p in pairs.values() if "one_slot" in p]
    return np.array(ratios)
