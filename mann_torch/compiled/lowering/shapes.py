"""Operations that only move elements: all become views, concatenations or reshapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..graph.nodes import Graph, IndexMap, Node
from ..graph.reshapes import expand, narrow, permute, reshape
from ..graph.views import view
from .registry import lowers

_END = 2**62


def dim_of(x: Node, dim: int) -> int:
    return dim % max(len(x.shape), 1)


def bounds(size: int, start: Any, end: Any, step: int) -> tuple[int, int]:
    """First index and number of elements of a Python slice."""
    start = 0 if start is None else start
    end = size if end is None else min(end, _END)
    low = min(max(start + size if start < 0 else start, 0), size)
    high = min(max(end + size if end < 0 else end, 0), size)
    return low, max(0, -(-(high - low) // step))


@lowers(
    "view.default",
    "reshape.default",
    "_unsafe_view.default",
    "_reshape_alias.default",
    "unsqueeze.default",
    "squeeze.dim",
    "squeeze.dims",
    "squeeze.default",
    "unflatten.int",
)
def _reshape(g: Graph, kind: str, x: Node, *_: Any, shape: Sequence[int]) -> Node:
    return reshape(g, x, shape)


@lowers("expand.default")
def _expand(g: Graph, kind: str, x: Node, *_: Any, shape: Sequence[int], **__: Any) -> Node:
    return expand(g, x, shape)


@lowers("permute.default")
def _permute(g: Graph, kind: str, x: Node, order: Sequence[int]) -> Node:
    return permute(g, x, [dim_of(x, d) for d in order])


def turned(g: Graph, x: Node, dim: int) -> tuple[Node, list[int]]:
    """With a dimension moved to the end, and the permutation that undoes it."""
    rank = len(x.shape)
    order = [d for d in range(rank) if d != dim % rank] + [dim % rank]
    return permute(g, x, order), [order.index(d) for d in range(rank)]


@lowers("transpose.int")
def _transpose(g: Graph, kind: str, x: Node, a: int, b: int) -> Node:
    order = list(range(len(x.shape)))
    a, b = dim_of(x, a), dim_of(x, b)
    order[a], order[b] = b, a
    return permute(g, x, order)


@lowers("t.default", "numpy_T.default")
def _t(g: Graph, kind: str, x: Node) -> Node:
    return permute(g, x, range(len(x.shape))[::-1])


@lowers("slice.Tensor")
def _slice(
    g: Graph, kind: str, x: Node, dim: int = 0, start: Any = None, end: Any = None, step: int = 1
) -> Node:
    dim = dim_of(x, dim)
    low, count = bounds(x.shape[dim], start, end, step)
    return narrow(g, x, dim, low, count, step)


@lowers("select.int")
def _select(g: Graph, kind: str, x: Node, dim: int, index: int) -> Node:
    dim = dim_of(x, dim)
    one = narrow(g, x, dim, index % x.shape[dim], 1)
    return reshape(g, one, x.shape[:dim] + x.shape[dim + 1 :])


@lowers("split_with_sizes.default")
def _split(g: Graph, kind: str, x: Node, sizes: Sequence[int], dim: int = 0) -> tuple[Node, ...]:
    dim, start, parts = dim_of(x, dim), 0, []
    for size in sizes:
        parts.append(narrow(g, x, dim, start, size))
        start += size
    return tuple(parts)


@lowers("split.Tensor")
def _split_even(g: Graph, kind: str, x: Node, size: int, dim: int = 0) -> tuple[Node, ...]:
    total = x.shape[dim_of(x, dim)]
    sizes = [min(size, total - start) for start in range(0, total, size)]
    return _split(g, kind, x, sizes, dim)


@lowers("unbind.int")
def _unbind(g: Graph, kind: str, x: Node, dim: int = 0) -> tuple[Node, ...]:
    return tuple(_select(g, kind, x, dim, i) for i in range(x.shape[dim_of(x, dim)]))


@lowers("flip.default")
def _flip(g: Graph, kind: str, x: Node, dims: Sequence[int]) -> Node:
    for d in dims if x.shape else ():
        d = dim_of(x, d)
        x = narrow(g, x, d, x.shape[d] - 1, x.shape[d], -1)
    return x


@lowers("diagonal.default")
def _diagonal(g: Graph, kind: str, x: Node, offset: int = 0, dim1: int = 0, dim2: int = 1) -> Node:
    a, b = dim_of(x, dim1), dim_of(x, dim2)
    row, column = max(-offset, 0), max(offset, 0)
    count = max(0, min(x.shape[a] - row, x.shape[b] - column))
    kept = [d for d in range(len(x.shape)) if d not in (a, b)]
    shape = [*(x.shape[d] for d in kept), count]
    maps = []
    for d in range(len(x.shape)):
        place = kept.index(d) if d in kept else len(kept)
        first = {a: row, b: column}.get(d, 0)
        maps.append(IndexMap(first, tuple(int(i == place) for i in range(len(shape)))))
    return view(g, x, shape, maps)


@lowers("unfold.default")
def _unfold(g: Graph, kind: str, x: Node, dim: int, size: int, step: int) -> Node:
    if not x.shape:
        return reshape(g, x, (size,))
    dim, rank = dim_of(x, dim), len(x.shape)
    count = (x.shape[dim] - size) // step + 1
    shape = (*x.shape[:dim], count, *x.shape[dim + 1 :], size)
    maps = [IndexMap(0, tuple(int(i == d) for i in range(rank + 1))) for d in range(rank)]
    maps[dim] = IndexMap(0, tuple({dim: step, rank: 1}.get(i, 0) for i in range(rank + 1)))
    return view(g, x, shape, maps)
