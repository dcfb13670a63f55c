"""Elements chosen by numbers known only at run time: every candidate is compared with the index."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..arithmetic import broadcast, pointwise
from ..graph import Graph, Node
from ..tracing import Untraceable
from ..views import expand, narrow, permute, reshape
from .registry import as_kind, lowers


@lowers("gather.default")
def gather(g: Graph, kind: str, x: Node, dim: int, index: Node, **_: Any) -> Node:
    """out[..., i, ...] = x[..., index[..., i, ...], ...]; other dimensions as in the index."""
    if not x.shape:
        return expand(g, x, index.shape)
    dim %= len(x.shape)
    for d, size in enumerate(index.shape):
        if d != dim:
            x = narrow(g, x, d, 0, size)
    order = [d for d in range(len(x.shape)) if d != dim] + [dim]
    back = [order.index(d) for d in range(len(order))]
    turned = permute(g, x, order), permute(g, index, order)
    return permute(g, g.node("gather", turned, turned[1].shape, x.kind), back)


def scattered(g: Graph, op: str, x: Node, dim: int, index: Node, new: Node) -> Node:
    """x with `new` put at, or added to, the places that the index says."""
    dim %= max(len(x.shape), 1)
    order = [d for d in range(len(x.shape)) if d != dim] + [dim]
    back = [order.index(d) for d in range(len(order))]
    if any(x.shape[d] != index.shape[d] for d in range(len(x.shape)) if d != dim):
        raise Untraceable("a scatter whose index is smaller than its target")
    for d, size in enumerate(index.shape):
        new = narrow(g, new, d, 0, size)
    turned = [permute(g, part, order) for part in (x, index, new)]
    return permute(g, g.node(op, turned, turned[0].shape, x.kind), back)


@lowers("scatter_add.default")
def _scatter_add(g: Graph, kind: str, x: Node, dim: int, index: Node, new: Node) -> Node:
    return scattered(g, "scatter_add", x, dim, index, new)


@lowers("scatter.src", "scatter.value")
def _scatter(g: Graph, kind: str, x: Node, dim: int, index: Node, new: Any) -> Node:
    new = as_kind(g, new, kind)
    return scattered(g, "scatter", x, dim, index, expand(g, new, index.shape) if not new.shape else new)


def _merged(
    g: Graph, x: Node, indices: Sequence[Node | None]
) -> tuple[Node, int, Node, tuple[int, ...], tuple[int, ...]]:
    """x with its indexed dimensions joined to one (dim), the index along it, and both shapes."""
    places = [d for d, i in enumerate(indices) if i is not None]
    chosen = [i for i in indices if i is not None]
    if any(i.kind == "b" for i in chosen):
        raise Untraceable("indexing by a mask: its size depends on data; use torch.where")
    if places != list(range(places[0], places[-1] + 1)):
        raise Untraceable("index tensors with a slice between them")
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
    row = reshape(g, flat, (number,))
    column = reshape(g, row, (*(1,) * len(before), number, *(1,) * len(after)))
    spread = expand(g, column, (*before, number, *after))
    return joined, first, spread, (*before, *shape, *after), (*before, number, *after)


@lowers("index.Tensor", "_unsafe_index.Tensor")
def _index(g: Graph, kind: str, x: Node, indices: Sequence[Node | None]) -> Node:
    joined, dim, index, shape, _ = _merged(g, x, indices)
    return reshape(g, gather(g, kind, joined, dim, index), shape)


@lowers("index_put.default", "_unsafe_index_put.default", "_index_put_impl.default")
def _index_put(
    g: Graph, kind: str, x: Node, indices: Sequence[Node | None], new: Any,
    accumulate: bool = False, *_: Any,
) -> Node:
    joined, dim, index, shape, flat = _merged(g, x, indices)
    values = reshape(g, expand(g, as_kind(g, new, kind), shape), flat)
    op = "scatter_add" if accumulate else "scatter"
    return reshape(g, scattered(g, op, joined, dim, index, values), x.shape)


@lowers("index_select.default")
def _index_select(g: Graph, kind: str, x: Node, dim: int, index: Node) -> Node:
    indices: list[Node | None] = [None] * len(x.shape)
    indices[dim % len(x.shape)] = index
    return _index(g, kind, x, indices)


def _ordered(
    g: Graph, x: Node, dim: int, count: int, descending: bool
) -> tuple[Node, Node]:
    """The first `count` elements along a dimension in order, and their indices."""
    if not x.shape:
        return x, g.full(0, (), "i")
    dim %= len(x.shape)
    order = [d for d in range(len(x.shape)) if d != dim] + [dim]
    back = [order.index(d) for d in range(len(order))]
    turned = permute(g, x, order)
    shape = (*turned.shape[:-1], count)
    index = g.node("order", (turned,), shape, "i", (descending,))
    values = g.node("gather", (turned, index), shape, x.kind)
    return permute(g, values, back), permute(g, index, back)


@lowers("topk.default")
def _topk(
    g: Graph, kind: str, x: Node, k: int, dim: int = -1, largest: bool = True, sorted: bool = True
) -> tuple[Node, Node]:
    return _ordered(g, x, dim, k, largest)


@lowers("sort.default", "sort.stable")
def _sort(
    g: Graph, kind: str, x: Node, dim: int = -1, descending: bool = False, **_: Any
) -> tuple[Node, Node]:
    return _ordered(g, x, dim, x.shape[dim] if x.shape else 1, descending)
