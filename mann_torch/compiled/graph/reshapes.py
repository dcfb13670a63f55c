"""Slices, permutations, broadcasts and reshapes, all written as views where they can be."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .nodes import Graph, IndexMap, Node, Shape, identity_maps, strides_of
from .views import is_pointwise, rebuilt, view

#: So many operations are searched for a reshape that another undoes.
_NEAR = 64


def narrow(g: Graph, x: Node, dim: int, start: int, length: int, step: int = 1) -> Node:
    """`length` elements along a dimension, from `start` on, every `step`-th."""
    shape = (*x.shape[:dim], length, *x.shape[dim + 1 :])
    maps = [*identity_maps(shape)]
    maps[dim] = IndexMap(start, tuple(s * step for s in maps[dim].steps))
    return view(g, x, shape, maps)


def permute(g: Graph, x: Node, order: Sequence[int]) -> Node:
    """Dimension i of the result is dimension order[i] of x."""
    rank = len(x.shape)
    maps = [IndexMap(0, tuple(int(order[i] == d) for i in range(rank))) for d in range(rank)]
    return view(g, x, [x.shape[d] for d in order], maps)


def expand(g: Graph, x: Node, shape: Sequence[int]) -> Node:
    """Broadcast to `shape`, dimensions aligned at the end."""
    shape, extra = tuple(shape), len(shape) - len(x.shape)
    maps = [
        IndexMap(0, tuple(int(i == d + extra and n != 1) for i in range(len(shape))))
        for d, n in enumerate(x.shape)
    ]
    return view(g, x, shape, maps)


def reshape(g: Graph, x: Node, shape: Sequence[int]) -> Node:
    """The same elements in row-major order, in another shape."""
    shape = tuple(shape)
    if shape == x.shape:
        return x
    if x.op == "full":
        return g.node("full", (), shape, x.kind, x.attributes)
    if x.op == "reshape":
        return reshape(g, x.args[0], shape)
    if is_pointwise(x) and _undone(x, shape):
        key = (x.number, shape)
        if key not in g.pushed:
            parts = [reshape(g, a, shape) for a in x.args]
            g.pushed[key] = rebuilt(g, x, parts, shape)
        return g.pushed[key]
    maps = _split_maps(x.shape, shape)
    if maps is not None:
        return view(g, x, shape, maps)
    if x.op == "table":
        return g.node("table", (), shape, x.kind, x.attributes)
    if x.op == "view":
        if _relabels(x):
            return reshape(g, x.args[0], shape)
        # Its elements lie apart.
        x = g.node("copy", (x,), x.shape, x.kind)
    return g.node("reshape", (x,), shape, x.kind)


def _relabels(x: Node) -> bool:
    """Whether a view has its source's elements in their row-major order."""
    source = x.args[0]
    if x.size != source.size:
        return False
    strides = strides_of(source.shape)
    steps = [
        sum(s * m.steps[i] for s, m in zip(strides, x.attributes, strict=True))
        for i in range(len(x.shape))
    ]
    own = [s if n != 1 else 0 for s, n in zip(strides_of(x.shape), x.shape, strict=True)]
    first = sum(s * m.offset for s, m in zip(strides, x.attributes, strict=True))
    return first == 0 and steps == own


def _undone(x: Node, shape: Shape) -> bool:
    """Whether the opposite reshape lies close below a pointwise operation."""
    seen, waiting = {x.number}, [x]
    while waiting and len(seen) < _NEAR:
        for a in waiting.pop().args:
            if a.op == "reshape" and a.args[0].shape == shape:
                return True
            if is_pointwise(a) and a.number not in seen:
                seen.add(a.number)
                waiting.append(a)
    return False


def _split_maps(old: Shape, new: Shape) -> list[IndexMap] | None:
    """Maps of a reshape that joins no dimensions; None for one that does."""
    rank = len(new)
    maps = [IndexMap(0, (0,) * rank)] * len(old)
    if math.prod(old) == 0:
        return maps
    j = 0
    for d, size in enumerate(old):
        if size == 1:
            continue
        taken, count = [], 1
        while count < size:
            if j >= rank:
                return None
            if new[j] != 1:
                taken.append(j)
                count *= new[j]
            j += 1
        if count != size:
            return None
        steps, step = [0] * rank, 1
        for i in reversed(taken):
            steps[i] = step
            step *= new[i]
        maps[d] = IndexMap(0, tuple(steps))
    return maps
