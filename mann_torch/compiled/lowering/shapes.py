"""Operations that only move elements: all become views, concatenations or reshapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from ..graph.arithmetic import pointwise
from ..graph.nodes import Graph, IndexMap, Node
from ..graph.reshapes import expand, narrow, permute, reshape
from ..graph.views import cat, view
from .registry import as_kind, lowers

_END = 2**62


def _dim(x: Node, dim: int) -> int:
    return dim % max(len(x.shape), 1)


def _bounds(size: int, start: Any, end: Any, step: int) -> tuple[int, int]:
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
    return permute(g, x, [_dim(x, d) for d in order])


def turned(g: Graph, x: Node, dim: int) -> tuple[Node, list[int]]:
    """With a dimension moved to the end, and the permutation that undoes it."""
    rank = len(x.shape)
    order = [d for d in range(rank) if d != dim % rank] + [dim % rank]
    return permute(g, x, order), [order.index(d) for d in range(rank)]


@lowers("transpose.int")
def _transpose(g: Graph, kind: str, x: Node, a: int, b: int) -> Node:
    order = list(range(len(x.shape)))
    a, b = _dim(x, a), _dim(x, b)
    order[a], order[b] = b, a
    return permute(g, x, order)


@lowers("t.default", "numpy_T.default")
def _t(g: Graph, kind: str, x: Node) -> Node:
    return permute(g, x, range(len(x.shape))[::-1])


@lowers("slice.Tensor")
def _slice(
    g: Graph, kind: str, x: Node, dim: int = 0, start: Any = None, end: Any = None, step: int = 1
) -> Node:
    dim = _dim(x, dim)
    low, count = _bounds(x.shape[dim], start, end, step)
    return narrow(g, x, dim, low, count, step)


@lowers("select.int")
def _select(g: Graph, kind: str, x: Node, dim: int, index: int) -> Node:
    dim = _dim(x, dim)
    one = narrow(g, x, dim, index % x.shape[dim], 1)
    return reshape(g, one, x.shape[:dim] + x.shape[dim + 1 :])


@lowers("split_with_sizes.default")
def _split(g: Graph, kind: str, x: Node, sizes: Sequence[int], dim: int = 0) -> tuple[Node, ...]:
    dim, start, parts = _dim(x, dim), 0, []
    for size in sizes:
        parts.append(narrow(g, x, dim, start, size))
        start += size
    return tuple(parts)


@lowers("split.Tensor")
def _split_even(g: Graph, kind: str, x: Node, size: int, dim: int = 0) -> tuple[Node, ...]:
    total = x.shape[_dim(x, dim)]
    sizes = [min(size, total - start) for start in range(0, total, size)]
    return _split(g, kind, x, sizes, dim)


@lowers("unbind.int")
def _unbind(g: Graph, kind: str, x: Node, dim: int = 0) -> tuple[Node, ...]:
    return tuple(_select(g, kind, x, dim, i) for i in range(x.shape[_dim(x, dim)]))


@lowers("cat.default")
def _cat(g: Graph, kind: str, parts: Sequence[Node], dim: int = 0) -> Node:
    # torch lets an empty row (0,) pass whatever the others' rank.
    kept = [as_kind(g, p, kind) for p in parts if p.shape != (0,)] or [parts[0]]
    return cat(g, kept, _dim(kept[0], dim))


@lowers("flip.default")
def _flip(g: Graph, kind: str, x: Node, dims: Sequence[int]) -> Node:
    for d in dims if x.shape else ():
        d = _dim(x, d)
        x = narrow(g, x, d, x.shape[d] - 1, x.shape[d], -1)
    return x


@lowers("as_strided.default")
def _as_strided(
    g: Graph,
    kind: str,
    x: Node,
    size: Sequence[int],
    strides: Sequence[int],
    offset: int | None = None,
    *,
    like: Tensor,
) -> Node:
    whole = like.numel() * like.element_size() == like.untyped_storage().nbytes()
    if not (whole and like.is_contiguous()):
        raise NotImplementedError("of a part of a tensor")
    return view(g, reshape(g, x, (x.size,)), size, [IndexMap(offset or 0, tuple(strides))])


@lowers("diagonal.default")
def _diagonal(g: Graph, kind: str, x: Node, offset: int = 0, dim1: int = 0, dim2: int = 1) -> Node:
    a, b = _dim(x, dim1), _dim(x, dim2)
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
def _slice_scatter(
    g: Graph,
    kind: str,
    x: Node,
    new: Node,
    dim: int = 0,
    start: Any = None,
    end: Any = None,
    step: int = 1,
) -> Node:
    dim = _dim(x, dim)
    low, count = _bounds(x.shape[dim], start, end, step)
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
    dim = _dim(x, dim)
    index %= x.shape[dim]
    one = reshape(g, new, (*x.shape[:dim], 1, *x.shape[dim + 1 :]))
    return _slice_scatter(g, kind, x, one, dim, index, index + 1)


@lowers("diagonal_scatter.default")
def _diagonal_scatter(
    g: Graph, kind: str, x: Node, new: Node, offset: int = 0, dim1: int = 0, dim2: int = 1
) -> Node:
    """`new` spread over rows and columns, chosen where a row meets its column."""
    a, b = _dim(x, dim1), _dim(x, dim2)
    row, rank = max(-offset, 0), len(x.shape)
    count = new.shape[-1]
    room = g.full(0, (*new.shape[:-1], x.shape[a]), kind)
    padded = _slice_scatter(g, kind, room, new, -1, row, row + count)
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


@lowers("unfold.default")
def _unfold(g: Graph, kind: str, x: Node, dim: int, size: int, step: int) -> Node:
    if not x.shape:
        return reshape(g, x, (size,))
    dim, rank = _dim(x, dim), len(x.shape)
    count = (x.shape[dim] - size) // step + 1
    shape = (*x.shape[:dim], count, *x.shape[dim + 1 :], size)
    maps = [IndexMap(0, tuple(int(i == d) for i in range(rank + 1))) for d in range(rank)]
    maps[dim] = IndexMap(0, tuple({dim: step, rank: 1}.get(i, 0) for i in range(rank + 1)))
    return view(g, x, shape, maps)


@lowers("repeat.default")
def _repeat(g: Graph, kind: str, x: Node, counts: Sequence[int]) -> Node:
    x = reshape(g, x, (1,) * (len(counts) - len(x.shape)) + x.shape)
    for d, count in enumerate(counts):
        x = cat(g, [x] * count, d) if count else narrow(g, x, d, 0, 0)
    return x
