"""What is known of a problem: numbers, how far ours may be from them, and how ours is found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from .run import Run

Measure = Callable[[Run], float]
#: Relative, of a closed form.
CLOSED = 1e-6
#: Relative, of what was published in single precision: 4 digits.
SINGLE = 1e-4
#: Of the last place printed: a half, and what rounding twice may add.
LAST_PLACE = 0.51


@dataclass(frozen=True)
class Mark:
    """Where a known number stands in a picture: at a time [s], in a column of an array.

    What the array holds is larger than the number by `shift`.
    """

    array: str
    column: int
    time: float
    shift: float = 0.0


@dataclass(frozen=True)
class Known:
    """One number. `measure` None: it is known, and can't be computed from what is published."""

    quantity: str
    value: float
    within: float  # absolute, of ours from the value
    digits: str  # the value as it is told
    source: str
    measure: Measure | None = None
    mark: Mark | None = None
    side: str = ""  # "<=" or ">=": the value is a bound
    note: str = ""

    def agrees(self, ours: float) -> bool:
        """Whether our number is the known one, as far as that is known."""
        if not math.isfinite(ours):
            return False
        if self.side == "<=":
            return ours <= self.value
        if self.side == ">=":
            return ours >= self.value
        return abs(ours - self.value) <= self.within


@dataclass(frozen=True)
class Case:
    """A rollout, or some side by side, of what overrides of `simulate` say."""

    title: str
    overrides: tuple[str, ...]
    sample_dt: float  # [s] of what is kept and measured
    known: tuple[Known, ...]
    shown: tuple[str, ...] = ()  # arrays in the picture beside output and input
    others: tuple[tuple[str, ...], ...] = ()  # overrides more, each for a rollout beside
    until: float | None = None  # [s], of the picture


@dataclass(frozen=True)
class Problem:
    """Cases of one problem, by name."""

    title: str
    source: str
    cases: dict[str, Case]


def printed(
    quantity: str,
    digits: str,
    measure: Measure | None,
    mark: Mark | None = None,
    source: str = "independent simulator",
    note: str = "",
) -> Known:
    """A number as it is printed: ours rounds to it."""
    mantissa, _, power = digits.partition("e")
    places = len(mantissa.partition(".")[2]) - int(power or 0)
    within = LAST_PLACE * 10.0**-places
    return Known(quantity, float(digits), within, digits, source, measure, mark, note=note)


def closed(
    quantity: str, value: float, measure: Measure, mark: Mark | None = None, floor: float = 0.0
) -> Known:
    """A closed form; `floor` is what a value near 0 is known to."""
    within = max(CLOSED * abs(value), floor)
    return Known(quantity, value, within, f"{value:.9g}", "closed form", measure, mark)


def single(
    quantity: str, digits: str, measure: Measure | None, mark: Mark | None = None, note: str = ""
) -> Known:
    """A number that was published in single precision."""
    value = float(digits)
    within = max(SINGLE * abs(value), 1e-6)
    return Known(quantity, value, within, digits, "published", measure, mark, note=note)


def at_most(quantity: str, value: float, measure: Measure, source: str = "claim") -> Known:
    """A number that ours may not pass."""
    return Known(quantity, value, 0.0, f"{value:g}", source, measure, side="<=")


def at_least(quantity: str, value: float, measure: Measure, source: str = "claim") -> Known:
    """A number that ours must reach."""
    return Known(quantity, value, 0.0, f"{value:g}", source, measure, side=">=")
