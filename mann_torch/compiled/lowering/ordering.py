"""Orders: sorting, the k-th element, running extremes, and places in a sorted row."""

from __future__ import annotations

from typing import Any

from ..graph.arithmetic import pointwise, reduce
from ..graph.nodes import Graph, Node
from ..graph.reshapes import narrow, permute, reshape
from .pointwise import isnan
from .reductions import arg_extreme, kept
from .registry import as_kind, common_kind, dims_of, lowers
from .shapes import turned


def ordered(g: Graph, x: Node, dim: int, count: int, descending: bool) -> tuple[Node, Node]:
    """The first `count` elements along a dimension in order, and their indices."""
    if not x.shape:
        return x, g.full(0, (), "i")
    row, back = turned(g, x, dim)
    shape = (*row.shape[:-1], count)
    index = g.node("order", (row,), shape, "i", (descending,))
    values = g.node("gather", (row, index), shape, x.kind)
    return permute(g, values, back), permute(g, index, back)


@lowers("topk.default")
def _topk(
    g: Graph, kind: str, x: Node, k: int, dim: int = -1, largest: bool = True, sorted: bool = True
) -> tuple[Node, Node]:
    return ordered(g, x, dim, k, largest)


@lowers("sort.default", "sort.stable")
def _sort(
    g: Graph, kind: str, x: Node, dim: int = -1, descending: bool = False, **_: Any
) -> tuple[Node, Node]:
    return ordered(g, x, dim, x.shape[dim] if x.shape else 1, descending)


@lowers("kthvalue.default")
def _kth(
    g: Graph, kind: str, x: Node, k: int, dim: int = -1, keepdim: bool = False
) -> tuple[Node, Node]:
    if not x.shape:
        return x, g.full(0, (), "i")
    dims = dims_of(x, dim)
    parts = [narrow(g, part, dims[0], k - 1, 1) for part in ordered(g, x, dim, k, False)]
    shape = tuple(n for d, n in enumerate(x.shape) if d not in dims)
    found = [kept(g, reshape(g, part, shape), x, dims, keepdim) for part in parts]
    return found[0], found[1]


@lowers("median.dim")
def _median(
    g: Graph, kind: str, x: Node, dim: int = -1, keepdim: bool = False
) -> tuple[Node, Node]:
    """The lower of two in the middle; NaN where there is one."""
    size = x.shape[dim] if x.shape else 1
    value, index = _kth(g, kind, x, (size + 1) // 2, dim, keepdim)
    if kind != "f" or not x.shape:
        return value, index
    dims = dims_of(x, dim)
    none = kept(g, reduce(g, "any", isnan(g, "b", x), dims), x, dims, keepdim)
    first = arg_extreme(g, "argmax", x, dim, keepdim)
    return (
        pointwise(g, "where", [none, g.full(float("nan"), (), "f"), value], "f"),
        pointwise(g, "where", [none, first, index], "i"),
    )


@lowers("median.default")
def _median_of_all(g: Graph, kind: str, x: Node) -> Node:
    return _median(g, kind, reshape(g, x, (x.size,)), 0)[0]


def _running(op: str) -> None:
    @lowers(f"{op}.default")
    def lower(g: Graph, kind: str, x: Node, dim: int) -> tuple[Node, Node]:
        if not x.shape:
            return x, g.full(0, (), "i")
        row, back = turned(g, x, dim)
        index = g.node(op, (row,), row.shape, "i")
        values = g.node("gather", (row, index), row.shape, x.kind)
        return permute(g, values, back), permute(g, index, back)


_running("cummax")
_running("cummin")


def _place(g: Graph, row: Node, x: Node, right: bool) -> Node:
    """How many of a sorted row (..., n) come before each x (..., k); NaN comes last."""
    kind = common_kind(row, x)
    row, x = as_kind(g, row, kind), as_kind(g, x, kind)
    row = reshape(g, row, (*row.shape[:-1], 1, row.shape[-1]))
    x = reshape(g, x, (*x.shape, 1))
    after = ("gt" if right else "ge") if kind == "f" else ("igt" if right else "ige")
    before = pointwise(g, "not", [pointwise(g, after, [row, x], "b")], "b")
    return reduce(g, "sum", as_kind(g, before, "i"), [len(before.shape) - 1])


@lowers("searchsorted.Tensor", "searchsorted.Scalar")
def _searchsorted(
    g: Graph,
    kind: str,
    row: Node,
    x: Any,
    *,
    right: bool = False,
    side: str | None = None,
    sorter: Node | None = None,
    **_: Any,
) -> Node:
    if sorter is not None:
        raise NotImplementedError("with a sorter: sort first")
    if not isinstance(x, Node):
        x = g.full(x, (), "f" if isinstance(x, float) else "i")
    from_right = right or side == "right"
    if len(row.shape) == 1:
        found = _place(g, row, reshape(g, x, (x.size,)), from_right)
        return reshape(g, found, x.shape)
    return _place(g, row, x, from_right)


@lowers("bucketize.Tensor", "bucketize.Scalar")
def _bucketize(g: Graph, kind: str, x: Any, row: Node, *, right: bool = False, **_: Any) -> Node:
    return _searchsorted(g, kind, row, x, right=right)
