"""Tensors made of numbers alone."""

from __future__ import annotations

from typing import Any

from ..graph.arithmetic import pointwise
from ..graph.nodes import Graph, Node
from .registry import as_kind, lowers


@lowers("full.default", "new_full.default")
def _full(g: Graph, kind: str, *given: Any, shape: tuple[int, ...]) -> Node:
    return g.full(given[-1], shape, kind)


@lowers("scalar_tensor.default")
def _scalar(g: Graph, kind: str, value: Any) -> Node:
    return g.full(value, (), kind)


@lowers(
    "zeros.default",
    "zeros_like.default",
    "new_zeros.default",
    "empty.memory_format",
    "empty_like.default",
    "empty_permuted.default",
    "new_empty.default",
    "new_empty_strided.default",
    "empty_strided.default",
    "_efficientzerotensor.default",
    "_new_zeros_with_same_feature_meta.default",
)
def _zeros(g: Graph, kind: str, *_: Any, shape: tuple[int, ...], **__: Any) -> Node:
    return g.full(0, shape, kind)


@lowers("ones.default", "ones_like.default", "new_ones.default")
def _ones(g: Graph, kind: str, *_: Any, shape: tuple[int, ...]) -> Node:
    return g.full(1, shape, kind)


@lowers("full_like.default")
def _full_like(g: Graph, kind: str, x: Node, value: Any) -> Node:
    return g.full(value, x.shape, kind)


@lowers("fill.Scalar", "fill.Tensor", "copy.default")
def _fill(g: Graph, kind: str, x: Node, value: Any, *_: Any) -> Node:
    return pointwise(g, f"to_{kind}", [as_kind(g, value, kind)], kind, (), x.shape)


@lowers("arange.start_step")
def _arange(g: Graph, kind: str, start: Any, end: Any, step: Any = 1, **_: Any) -> Node:
    if any(isinstance(x, float) for x in (start, end, step)):
        raise NotImplementedError("of fractions: torch itself rounds them best")
    count = max(0, -(-(end - start) // step))
    return as_kind(g, g.iota(start, step, count), kind)
