"""Which function turns which torch operation into nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch

from ..graph.arithmetic import pointwise
from ..graph.nodes import Graph, Node
from ..real import Real
from ..trace.telling import UntraceableError

#: (graph, operands, keywords, kind of the result) -> node, or a tuple of them.
Lowering = Callable[..., Any]
LOWERINGS: dict[str, Lowering] = {}


def lowers(*names: str) -> Callable[[Lowering], Lowering]:
    """Register a function for operations such as ``mul.Tensor``."""

    def register(function: Lowering) -> Lowering:
        for name in names:
            LOWERINGS[name] = function
        return function

    return register


def kinds_of(real: Real) -> dict[torch.dtype, str]:
    """Our letters for the dtypes that lanes hold."""
    return {real.dtype: "f", torch.int64: "i", torch.bool: "b"}


def kind_of(real: Real, dtype: torch.dtype) -> str:
    """Our letter for a dtype; raises `UntraceableError` for one that lanes do not have."""
    kind = kinds_of(real).get(dtype)
    if kind is None:
        if dtype != torch.int32:  # the others would wrap around soon
            name = str(real.dtype).removeprefix("torch.")
            raise UntraceableError(f"numbers of {dtype}: lanes hold {name}, int64 and bool")
        kind = "i"
    return kind


def constant(g: Graph, value: Any, kind: str) -> Node:
    """A Python number as a node."""
    return g.full(value, (), kind)


def as_kind(g: Graph, x: Any, kind: str) -> Node:
    """An operand, number or node, converted to a kind of element."""
    if not isinstance(x, Node):
        return constant(g, x, kind)
    return x if x.kind == kind else pointwise(g, f"to_{kind}", [x], kind)


def common_kind(*operands: Any) -> str:
    """The kind that operands of several kinds are compared in."""
    kinds = {
        x.kind if isinstance(x, Node) else "b" if isinstance(x, bool) else "i"
        for x in operands
        if isinstance(x, Node) or not isinstance(x, float)
    }
    if any(isinstance(x, float) for x in operands) or "f" in kinds:
        return "f"
    return "i" if "i" in kinds else "b"


def dims_of(x: Node, dims: Any) -> list[int]:
    """Dimensions counted from 0; all of them if none are given."""
    if not x.shape:
        return []
    if dims is None or (isinstance(dims, Sequence) and not dims):
        return list(range(len(x.shape)))
    given = dims if isinstance(dims, Sequence) else [dims]
    return sorted(d % len(x.shape) for d in given)
