"""C++ text of the watch over leaves of the carry that must stay within the limit."""

from __future__ import annotations

import math

from .layout import Layout


def _ranges(layout: Layout) -> list[tuple[int, int, int]]:
    """First and last place in `f` of each watched leaf, and its number among them."""
    found = []
    for number, i in enumerate(layout.watched):
        _, offset = layout.carry_places[i]
        found.append((number, offset, offset + math.prod(layout.carry[i].shape)))
    return found


def beyond_text(layout: Layout) -> str:
    """Statements that mark lanes where a watched number is out of range."""
    lines = []
    for _, first, last in _ranges(layout):
        test = "bad = bad | ~lt(abs_(f[e]), splat(limit));"
        lines.append(f"for (int e = {first}; e < {last}; ++e) {test}")
    return "\n    ".join(lines)


def why_text(layout: Layout) -> str:
    """Statements that find the first such leaf of a lane."""
    lines = ["int found = 0;"]
    for number, first, last in _ranges(layout):
        lines.append(f"found = leaf(f, l, limit, {first}, {last});")
        lines.append(f"if (found) return {10 * number} + found;")
    return "\n    ".join(lines)
