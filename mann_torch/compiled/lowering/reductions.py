"""Sums, extremes, products of matrices, and running sums."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..graph.arithmetic import pointwise, reduce
from ..graph.nodes import Graph, Node
from ..graph.reshapes import permute, reshape
from .registry import as_kind, dims_of, lowers
from .shapes import turned


def kept(g: Graph, found: Node, x: Node, dims: Sequence[int], keepdim: bool) -> Node:
    """With the reduced dimensions as ones, where they are to stay."""
    if not keepdim:
        return found
    return reshape(g, found, tuple(1 if d in dims else n for d, n in enumerate(x.shape)))


def _reduction(op: str, *names: str) -> None:
    @lowers(*names)
    def lower(
        g: Graph, kind: str, x: Node, dims: Any = None, keepdim: bool = False, **_: Any
    ) -> Node:
        places = dims_of(x, dims)
        source = as_kind(g, x, kind)
        return kept(g, reduce(g, op, source, places), x, places, keepdim)


_reduction("sum", "sum.dim_IntList", "sum.default")
_reduction("prod", "prod.dim_int", "prod.default")
_reduction("amax", "amax.default", "max.default")
_reduction("amin", "amin.default", "min.default")
_reduction("any", "any.dim", "any.dims", "any.default")
_reduction("all", "all.dim", "all.dims", "all.default")


def _argument(op: str) -> None:
    @lowers(f"{op}.default")
    def lower(g: Graph, kind: str, x: Node, dim: int | None = None, keepdim: bool = False) -> Node:
        return arg_extreme(g, op, x, dim, keepdim)


def arg_extreme(g: Graph, op: str, x: Node, dim: int | None, keepdim: bool) -> Node:
    """Index of the first largest or smallest element."""
    if not x.shape:
        return g.full(0, (), "i")
    if dim is None:
        found = reduce(g, op, reshape(g, as_kind(g, x, _ordered(x)), (x.size,)), [0], "i")
        return reshape(g, found, (1,) * len(x.shape)) if keepdim else found
    dims = dims_of(x, dim)
    return kept(g, reduce(g, op, as_kind(g, x, _ordered(x)), dims, "i"), x, dims, keepdim)


def _ordered(x: Node) -> str:
    return "f" if x.kind == "f" else "i"


for _op in ("argmax", "argmin"):
    _argument(_op)


def _with_index(op: str) -> None:
    @lowers(f"{op}.dim")
    def lower(g: Graph, kind: str, x: Node, dim: int, keepdim: bool = False) -> tuple[Node, Node]:
        dims = dims_of(x, dim)
        values = kept(g, reduce(g, f"a{op}", x, dims), x, dims, keepdim)
        return values, arg_extreme(g, f"arg{op}", x, dim, keepdim)


for _op in ("max", "min"):
    _with_index(_op)


@lowers("mean.dim", "mean.default")
def _mean(g: Graph, kind: str, x: Node, dims: Any = None, keepdim: bool = False, **_: Any) -> Node:
    places = dims_of(x, dims)
    total = kept(g, reduce(g, "sum", x, places), x, places, keepdim)
    count = math.prod(x.shape[d] for d in places)
    return pointwise(g, "div", [total, g.full(float(count), (), "f")], "f")


@lowers("var.correction")
def _var(
    g: Graph, kind: str, x: Node, dims: Any = None, *, correction: Any = 1, keepdim: bool = False
) -> Node:
    places = dims_of(x, dims)
    apart = pointwise(g, "sub", [x, _mean(g, "f", x, places, True)], "f")
    total = reduce(g, "sum", pointwise(g, "mul", [apart, apart], "f"), places)
    count = max(
        0, math.prod(x.shape[d] for d in places) - (1 if correction is None else correction)
    )
    spread = pointwise(g, "div", [total, g.full(float(count), (), "f")], "f")
    return kept(g, spread, x, places, keepdim)


@lowers("var_mean.correction")
def _var_mean(
    g: Graph, kind: str, x: Node, dims: Any = None, *, correction: Any = 1, keepdim: bool = False
) -> tuple[Node, Node]:
    spread = _var(g, kind, x, dims, correction=correction, keepdim=keepdim)
    return spread, _mean(g, kind, x, dims, keepdim)


@lowers("mm.default", "bmm.default", "matmul.default")
def matmul(g: Graph, kind: str, a: Node, b: Node) -> Node:
    """(..., m, k), (..., k, n) -> (..., m, n): products, summed over k."""
    left = reshape(g, a, (*a.shape, 1))
    right = reshape(g, b, (*b.shape[:-2], 1, *b.shape[-2:]))
    product = pointwise(g, "mul" if kind == "f" else "imul", [left, right], kind)
    return reduce(g, "sum", product, [len(a.shape) - 1])


@lowers("dot.default", "vdot.default", "mv.default")
def _product_sum(g: Graph, kind: str, a: Node, b: Node) -> Node:
    product = pointwise(g, "mul" if kind == "f" else "imul", [a, b], kind)
    return reduce(g, "sum", product, [len(a.shape) - 1])


@lowers("_trilinear.default")
def _trilinear(g: Graph, kind: str, *given: Any) -> Node:
    """Three factors, each with ones put in at the dimensions it lacks, summed over some."""
    factors = []
    for x, missing in zip(given[:3], given[3:6], strict=True):
        shape = list(x.shape)
        for dim in missing:
            shape.insert(dim, 1)
        factors.append(reshape(g, x, shape))
    pair = pointwise(g, "mul", factors[:2], "f")
    return reduce(g, "sum", pointwise(g, "mul", [pair, factors[2]], "f"), given[6])


def _scan(op: str) -> None:
    @lowers(f"{op}.default")
    def lower(g: Graph, kind: str, x: Node, dim: int, **_: Any) -> Node:
        return scan(g, op, as_kind(g, x, kind), dim)


def scan(g: Graph, op: str, x: Node, dim: int) -> Node:
    """Running sums or products."""
    if not x.shape:
        return x
    row, back = turned(g, x, dim)
    return permute(g, g.node(op, (row,), row.shape, x.kind), back)


for _op in ("cumsum", "cumprod"):
    _scan(_op)


@lowers("native_layer_norm.default")
def _layer_norm(
    g: Graph, kind: str, x: Node, size: Sequence[int], weight: Any, bias: Any, eps: float
) -> tuple[Node, Node, Node]:
    """The normalised rows, their means, and one over their standard deviations."""
    dims = list(range(len(x.shape) - len(size), len(x.shape)))
    mean = _mean(g, "f", x, dims, True)
    apart = pointwise(g, "sub", [x, mean], "f")
    spread = _mean(g, "f", pointwise(g, "mul", [apart, apart], "f"), dims, True)
    deviation = pointwise(
        g, "sqrt", [pointwise(g, "add", [spread, g.full(eps, (), "f")], "f")], "f"
    )
    scale = pointwise(g, "reciprocal", [deviation], "f")
    found = pointwise(g, "mul", [apart, scale], "f")
    if weight is not None:
        found = pointwise(g, "mul", [found, weight], "f")
    if bias is not None:
        found = pointwise(g, "add", [found, bias], "f")
    return found, mean, scale
