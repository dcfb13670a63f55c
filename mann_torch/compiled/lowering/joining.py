"""Pieces put together, and values put into the places of others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..graph.arithmetic import pointwise
from ..graph.nodes import Graph, Node
from ..graph.reshapes import expand, narrow, permute, reshape
from ..graph.views import cat
from .registry import as_kind, lowers
from .shapes import bounds, dim_of


@lowers("cat.default")
def _cat(g: Graph, kind: str, parts: Sequence[Node], dim: int = 0) -> Node:
    # torch lets an empty row (0,) pass whatever the others' rank.
    kept = [as_kind(g, p, kind) for p in parts if p.shape != (0,)] or [parts[0]]
    return cat(g, kept, dim_of(kept[0], dim))


@lowers("constant_pad_nd.default")
def _pad(g: Graph, kind: str, x: Node, pads: Sequence[int], value: Any = 0) -> Node:
    for i in range(len(pads) // 2):
        d, before, after = len(x.shape) - 1 - i, pads[2 * i], pads[2 * i + 1]
        start, stop = max(-before, 0), x.shape[d] - max(-after, 0)
        x = narrow(g, x, d, start, stop - start)
        parts = [x]
        for size, place in ((before, 0), (after, 1)):
            if size > 0:
                shape = (*x.shape[:d], size, *x.shape[d + 1 :])
                parts.insert(place * len(parts), g.full(value, shape, x.kind))
        x = cat(g, parts, d)
    return x


@lowers("slice_scatter.default")
def slice_scatter(
    g: Graph,
    kind: str,
    x: Node,
    new: Node,
    dim: int = 0,
    start: Any = None,
    end: Any = None,
    step: int = 1,
) -> Node:
    """x with `new` in the place of a slice."""
    dim = dim_of(x, dim)
    low, count = bounds(x.shape[dim], start, end, step)
    parts, place = [], 0
    if step == 1:
        parts = [narrow(g, x, dim, 0, low), new]
        place = low + count
    else:
        for i in range(count):
            parts += [narrow(g, x, dim, place, low + i * step - place), narrow(g, new, dim, i, 1)]
            place = low + i * step + 1
    parts.append(narrow(g, x, dim, place, x.shape[dim] - place))
    return cat(g, [as_kind(g, p, kind) for p in parts], dim)


@lowers("select_scatter.default")
def _select_scatter(g: Graph, kind: str, x: Node, new: Node, dim: int, index: int) -> Node:
    dim = dim_of(x, dim)
    index %= x.shape[dim]
    one = reshape(g, new, (*x.shape[:dim], 1, *x.shape[dim + 1 :]))
    return slice_scatter(g, kind, x, one, dim, index, index + 1)


@lowers("diagonal_scatter.default")
def _diagonal_scatter(
    g: Graph, kind: str, x: Node, new: Node, offset: int = 0, dim1: int = 0, dim2: int = 1
) -> Node:
    """`new` spread over rows and columns, chosen where a row meets its column."""
    a, b = dim_of(x, dim1), dim_of(x, dim2)
    row, rank = max(-offset, 0), len(x.shape)
    count = new.shape[-1]
    room = g.full(0, (*new.shape[:-1], x.shape[a]), kind)
    padded = slice_scatter(g, kind, room, new, -1, row, row + count)
    rest = [d for d in range(rank) if d not in (a, b)]
    order = [rest.index(d) if d in rest else rank - 2 for d in range(rank) if d != b]
    spread = reshape(
        g, permute(g, padded, order), tuple(1 if d == b else n for d, n in enumerate(x.shape))
    )
    numbers = [
        reshape(
            g, g.iota(start, 1, x.shape[d]), tuple(x.shape[d] if k == d else 1 for k in range(rank))
        )
        for start, d in ((offset, a), (0, b))
    ]
    return pointwise(
        g, "where", [pointwise(g, "ieq", numbers, "b"), expand(g, spread, x.shape), x], kind
    )


@lowers("repeat.default")
def _repeat(g: Graph, kind: str, x: Node, counts: Sequence[int]) -> Node:
    x = reshape(g, x, (1,) * (len(counts) - len(x.shape)) + x.shape)
    for d, count in enumerate(counts):
        x = cat(g, [x] * count, d) if count else narrow(g, x, d, 0, 0)
    return x
