"""Distances between all points of two sets, as `torch.cdist` has them."""

from __future__ import annotations

from typing import Any

from ..graph.arithmetic import pointwise, reduce
from ..graph.nodes import Graph, Node
from ..graph.reshapes import reshape
from .registry import lowers


def _apart(g: Graph, a: Node, b: Node) -> Node:
    """(..., P, M), (..., R, M) -> (..., P, R, M)."""
    rows = reshape(g, a, (*a.shape[:-1], 1, a.shape[-1]))
    columns = reshape(g, b, (*b.shape[:-2], 1, *b.shape[-2:]))
    return pointwise(g, "sub", [rows, columns], "f")


def _known(p: float) -> None:
    if p not in (1.0, 2.0):
        raise NotImplementedError(f"with p={p}: only 1 and 2")


@lowers("_cdist_forward.default")
def _cdist(g: Graph, kind: str, a: Node, b: Node, p: float, *_: Any) -> Node:
    _known(p)
    apart = _apart(g, a, b)
    last = [len(apart.shape) - 1]
    if p == 1.0:
        return reduce(g, "sum", pointwise(g, "abs", [apart], "f"), last)
    squares = pointwise(g, "mul", [apart, apart], "f")
    return pointwise(g, "sqrt", [reduce(g, "sum", squares, last)], "f")


@lowers("_cdist_backward.default")
def _cdist_back(
    g: Graph, kind: str, gradient: Node, a: Node, b: Node, p: float, distance: Node
) -> Node:
    """Towards `a`; nothing where points meet."""
    _known(p)
    apart = _apart(g, a, b)
    shares = reshape(g, gradient, (*gradient.shape, 1))
    if p == 1.0:
        parts = pointwise(g, "mul", [shares, pointwise(g, "sign", [apart], "f")], "f")
    else:
        whole = reshape(g, distance, (*distance.shape, 1))
        zero = g.full(0.0, (), "f")
        met = pointwise(g, "eq", [whole, zero], "b")
        slope = pointwise(g, "div", [apart, whole], "f")
        slope = pointwise(g, "where", [met, zero, slope], "f")
        parts = pointwise(g, "mul", [shares, slope], "f")
    return reduce(g, "sum", parts, [len(parts.shape) - 2])
