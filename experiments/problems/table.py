"""What is known beside ours: rows, verdicts, tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..runs.writing import aligned
from .every import PROBLEMS
from .known import Known
from .rolling import CaseResult

AGREES, OFF, UNKNOWN = "agrees", "off", "not run"
HEAD = ("case", "quantity", "known", "source", "ours", "deviation", "spread", "within", "verdict")


@dataclass(frozen=True)
class Row:
    """One quantity. `spread`: how far ours at half the step is from ours."""

    problem: str
    case: str
    quantity: str
    known: float
    digits: str
    source: str
    ours: float
    within: float
    spread: float
    verdict: str
    note: str

    @property
    def deviation(self) -> float:
        """Relative; absolute where what is known is 0."""
        gap = self.ours - self.known
        return gap / abs(self.known) if self.known else gap

    @property
    def margin(self) -> float:
        """How far ours is in parts of what is allowed; NaN of a bound, and where nothing is run."""
        return abs(self.ours - self.known) / self.within if self.within else float("nan")


def rows_of(results: Mapping[tuple[str, str], CaseResult]) -> list[Row]:
    """Of all cases, in order."""
    found = []
    for (problem, case), result in results.items():
        told = PROBLEMS[problem].cases[case]
        for known, ours, finer in zip(
            told.known, result.ours.tolist(), result.finer.tolist(), strict=True
        ):
            found.append(
                Row(
                    problem,
                    told.title,
                    known.quantity,
                    known.value,
                    f"{known.side} {known.digits}".strip(),
                    known.source,
                    ours,
                    known.within,
                    abs(finer - ours),
                    verdict(known, ours),
                    known.note,
                )
            )
    return found


def verdict(known: Known, ours: float) -> str:
    """Of ours."""
    if known.measure is None:
        return UNKNOWN
    return AGREES if known.agrees(ours) else OFF


def score(rows: Sequence[Row]) -> str:
    """How many agree, in a sentence."""
    run = [row for row in rows if row.verdict != UNKNOWN]
    agree = sum(row.verdict == AGREES for row in run)
    left = len(rows) - len(run)
    told = f"{agree} of {len(run)} numbers agree"
    return told + (f", {left} can't be computed from what is published" if left else "")


def markdown(problem: str, rows: Sequence[Row]) -> str:
    """The table of one problem, and notes below it."""
    told = PROBLEMS[problem]
    body = [list(HEAD)]
    for row in rows:
        body.append(
            [
                row.case,
                row.quantity.replace("|", "\\|"),
                row.digits,
                row.source,
                _number(row.ours),
                "" if math.isnan(row.ours) else f"{row.deviation:+.1e}",
                "" if math.isnan(row.spread) else f"{row.spread:.0e}",
                "" if row.digits[:1] in "<>" else f"{row.within:.1e}",
                row.verdict,
            ]
        )
    notes = [f"- {row.case}, {row.quantity}: {row.note}." for row in rows if row.note]
    tail = "\n\n" + "\n".join(notes) if notes else ""
    return f"### {told.title}\n\n{told.source}.\n\n{aligned(body)}{tail}"


def csv_rows(rows: Sequence[Row]) -> list[list[object]]:
    """All of it as CSV."""
    found: list[list[object]] = [["problem", *HEAD, "note"]]
    for row in rows:
        found.append(
            [
                row.problem,
                row.case,
                row.quantity,
                row.digits,
                row.source,
                repr(row.ours),
                f"{row.deviation:.3e}",
                f"{row.spread:.3e}",
                f"{row.within:.3e}",
                row.verdict,
                row.note,
            ]
        )
    return found


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.9g}"
