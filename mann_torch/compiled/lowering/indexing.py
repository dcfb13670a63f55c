"""Elements chosen by numbers known only at run time: every candidate is compared with the index."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from ..graph.arithmetic import broadcast, pointwise
from ..graph.nodes import Graph, Node, Shape
from ..graph.reshapes import expand, narrow, permute, reshape
from ..graph.views import cat
from ..trace.telling import UntraceableError
from .registry import as_kind, lowers
from .shapes import turned


@lowers("gather.default")
def gather(g: Graph, kind: str, x: Node, dim: int, index: Node, **_: Any) -> Node:
    """out[..., i, ...] = x[..., index[..., i, ...], ...]; other dimensions as in the index."""
    if not x.shape:
        return expand(g, x, index.shape)
    dim %= len(x.shape)
    for d, size in enumerate(index.shape):
        if d != dim:
            x = narrow(g, x, d, 0, size)
    row, back = turned(g, x, dim)
    at = turned(g, index, dim)[0]
    return permute(g, g.node("gather", (row, at), at.shape, x.kind), back)


def scattered(g: Graph, op: str, x: Node, dim: int, index: Node, new: Node) -> Node:
    """x with `new` put at, or added to, the places that the index says."""
    if not x.shape:
        x, index, new = (reshape(g, part, (1,)) for part in (x, index, new))
        return reshape(g, scattered(g, op, x, 0, index, new), ())
    dim %= len(x.shape)
    for d, size in enumerate(index.shape):
        new = narrow(g, new, d, 0, size)
        if d != dim and size < x.shape[d]:
            first = narrow(g, x, d, 0, size)
            rest = narrow(g, x, d, size, x.shape[d] - size)
            return cat(g, [scattered(g, op, first, dim, index, new), rest], d)
    row, back = turned(g, x, dim)
    at = turned(g, index, dim)[0]
    put, _ = turned(g, new, dim)
    return permute(g, g.node(op, (row, at, put), row.shape, x.kind), back)


@lowers("scatter_add.default")
def _scatter_add(g: Graph, kind: str, x: Node, dim: int, index: Node, new: Node) -> Node:
    return scattered(g, "scatter_add", x, dim, index, new)


@lowers("scatter.src", "scatter.value")
def _scatter(g: Graph, kind: str, x: Node, dim: int, index: Node, new: Any) -> Node:
    new = as_kind(g, new, kind)
    new = expand(g, new, index.shape) if not new.shape else new
    return scattered(g, "scatter", x, dim, index, new)


@lowers("scatter_reduce.two")
def _scatter_reduce(
    g: Graph,
    kind: str,
    x: Node,
    dim: int,
    index: Node,
    new: Node,
    reduce: str,
    *,
    include_self: bool = True,
) -> Node:
    if reduce != "sum" or not include_self:
        raise NotImplementedError(f"by {reduce}, include_self={include_self}: only a sum with self")
    return scattered(g, "scatter_add", x, dim, index, new)


class _Indexed(NamedTuple):
    """x with its indexed dimensions joined to one, and the index along it."""

    joined: Node
    dim: int
    along: Node  # spread over all other dimensions
    order: list[int]  # of x's dimensions before they were joined
    shape: Shape  # of the result


def _indexed(g: Graph, x: Node, indices: Sequence[Node | None]) -> _Indexed:
    places = [d for d, i in enumerate(indices) if i is not None]
    chosen = [i for i in indices if i is not None]
    if any(i.kind == "b" for i in chosen):
        raise UntraceableError("indexing by a mask: its size depends on data; use torch.where")
    order = list(range(len(x.shape)))
    if places != list(range(places[0], places[-1] + 1)):  # what they choose comes first
        order = places + [d for d in order if d not in places]
        x, places = permute(g, x, order), list(range(len(places)))
    first, count = places[0], len(places)
    shape = broadcast([i.shape for i in chosen])
    flat = g.full(0, shape, "i")
    for d, index in zip(places, chosen, strict=True):
        size = x.shape[d]
        below = pointwise(g, "ilt", [index, g.full(0, (), "i")], "b")
        wrapped = pointwise(g, "iadd", [index, g.full(size, (), "i")], "i")
        index = expand(g, pointwise(g, "where", [below, wrapped, index], "i"), shape)
        scaled = pointwise(g, "imul", [flat, g.full(size, (), "i")], "i")
        flat = pointwise(g, "iadd", [scaled, index], "i")
    before, after = x.shape[:first], x.shape[first + count :]
    joined = reshape(g, x, (*before, math.prod(x.shape[first : first + count]), *after))
    number = math.prod(shape)
    column = reshape(g, flat, (*(1,) * len(before), number, *(1,) * len(after)))
    spread = expand(g, column, (*before, number, *after))
    return _Indexed(joined, first, spread, order, (*before, *shape, *after))


@lowers("index.Tensor", "_unsafe_index.Tensor")
def _index(g: Graph, kind: str, x: Node, indices: Sequence[Node | None]) -> Node:
    found = _indexed(g, x, indices)
    return reshape(g, gather(g, kind, found.joined, found.dim, found.along), found.shape)


@lowers("index_put.default", "_unsafe_index_put.default", "_index_put_impl.default")
def _index_put(
    g: Graph,
    kind: str,
    x: Node,
    indices: Sequence[Node | None],
    new: Any,
    accumulate: bool = False,
    *_: Any,
) -> Node:
    new = as_kind(g, new, kind)
    masks = [i for i in indices if i is not None and i.kind == "b"]
    if len(masks) == 1 == len(indices) and new.size == 1 and not accumulate:
        shape = (*masks[0].shape, *(1,) * (len(x.shape) - len(masks[0].shape)))
        parts = [reshape(g, masks[0], shape), reshape(g, new, ()), x]
        return pointwise(g, "where", parts, kind)
    found = _indexed(g, x, indices)
    values = reshape(g, expand(g, new, found.shape), found.along.shape)
    op = "scatter_add" if accumulate else "scatter"
    put = scattered(g, op, found.joined, found.dim, found.along, values)
    turned_back = [found.order.index(d) for d in range(len(found.order))]
    return permute(g, reshape(g, put, [x.shape[d] for d in found.order]), turned_back)


@lowers("put.default")
def _put(g: Graph, kind: str, x: Node, index: Node, new: Node, accumulate: bool = False) -> Node:
    flat = reshape(g, x, (x.size,))
    put = _index_put(g, kind, flat, [index], reshape(g, new, index.shape), accumulate)
    return reshape(g, put, x.shape)


@lowers("index_select.default")
def _index_select(g: Graph, kind: str, x: Node, dim: int, index: Node) -> Node:
    if not x.shape:
        return x
    indices: list[Node | None] = [None] * len(x.shape)
    indices[dim % len(x.shape)] = reshape(g, index, (index.size,))
    return _index(g, kind, x, indices)


@lowers("embedding.default")
def _embedding(g: Graph, kind: str, rows: Node, index: Node, *_: Any) -> Node:
    return _index(g, kind, rows, [index])
