"""The paper's tables beside ours: cells with verdicts, reductions, paired differences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .config import TableConfig
from .results import Interval, Results

VERDICTS = ("within 5 %", "within 10 %", "off")


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


def score(all_cells: Iterable[Cell]) -> str:
    """How many published figures are met, in one line."""
    distinct = published(all_cells)
    close = sum(cell.verdict == VERDICTS[0] for cell in distinct)
    fair = sum(cell.verdict != VERDICTS[2] for cell in distinct)
    return (
        f"{len(distinct)} published figures: {fair} within 10 %, {close} within 5 %, "
        f"{len(distinct) - fair} off"
    )


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
        "SRMSE x 10^3 [rad], mean ± standard deviation over draws.",
        "",
    ]
    body = [["controller", "joint", "paper", "ours", "difference", "verdict"]]
    for cell in cells(table, results):
        body.append(
            [
                cell.label,
                str(cell.joint),
                "-" if cell.paper is None else f"{cell.paper:g}",
                f"{cell.mean:.2f}" + ("" if math.isnan(cell.sd) else f" ± {cell.sd:.2f}"),
                "-" if cell.paper is None else f"{cell.difference:+.1f} %",
                cell.verdict or "-",
            ]
        )
    for joint, (printed, ours, change) in enumerate(reductions(table, results), start=1):
        body.append(
            [
                "% reduction from I to II",
                str(joint),
                f"{printed:g} %",
                f"{ours:.1f} %",
                f"II - I, paired: {change}",
                "interval excludes 0" if change.excludes_zero else "interval includes 0",
            ]
        )
    return "\n".join([*lines, aligned(body)])


def aligned(body: Sequence[Sequence[str]]) -> str:
    """A Markdown table whose columns line up in a terminal too; the first row is the head."""
    widths = [max(len(row[i]) for row in body) for i in range(len(body[0]))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |"
        for row in body
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def csv_rows(all_cells: Iterable[Cell]) -> str:
    """Every cell as CSV."""
    lines = [
        "table,controller,scenario,variant,metric,joint,paper,mean,sd,difference_percent,verdict"
    ]
    for c in all_cells:
        paper = "" if c.paper is None else f"{c.paper:g}"
        difference = "" if c.paper is None else f"{c.difference:.3f}"
        sd = "" if math.isnan(c.sd) else f"{c.sd:.5f}"
        lines.append(
            f'"{c.table}","{c.label}",{c.scenario},{c.variant},{c.metric},{c.joint},'
            f"{paper},{c.mean:.5f},{sd},{difference},{c.verdict}"
        )
    return "\n".join(lines) + "\n"


def slots_table(table_cells: Iterable[Cell]) -> np.ndarray:
    """Means of the one-slot baseline over the paper's controller, per table and joint."""
    pairs: dict[tuple[str, str, int], dict[str, float]] = {}
    for cell in table_cells:
        pairs.setdefault((cell.table, cell.scenario, cell.joint), {})[cell.variant] = cell.mean
    ratios = [p["one_slot"] / p["reallocating_initial"] for p in pairs.values() if "one_slot" in p]
    return np.array(ratios)
