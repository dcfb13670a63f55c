"""Indices of elements: maps composed, made linear, and written out."""

from __future__ import annotations

from collections.abc import Sequence

from ..graph.nodes import IndexMap, Node, Shape, strides_of


def composed(inner: IndexMap, outer: Sequence[IndexMap]) -> IndexMap:
    width = len(outer[0].steps) if outer else 0
    offset = inner.offset + sum(s * m.offset for s, m in zip(inner.steps, outer, strict=True))
    steps = [
        sum(s * m.steps[i] for s, m in zip(inner.steps, outer, strict=True)) for i in range(width)
    ]
    return IndexMap(offset, tuple(steps))


def linear(maps: Sequence[IndexMap], shape: Shape) -> tuple[int, tuple[int, ...]]:
    """The linear index that maps reach in an array of this shape."""
    width = len(maps[0].steps) if maps else 0
    strides = strides_of(shape)
    offset = sum(s * m.offset for s, m in zip(strides, maps, strict=True))
    steps = tuple(
        sum(s * m.steps[i] for s, m in zip(strides, maps, strict=True)) for i in range(width)
    )
    return offset, steps


def reduced_maps(node: Node) -> list[IndexMap]:
    """Indices of a reduction's operand from those of its result and those it sums over."""
    (a,) = node.args
    dims = node.attributes
    kept = [d for d in range(len(a.shape)) if d not in dims]
    width = len(a.shape)
    maps = []
    for d in range(width):
        place = len(kept) + dims.index(d) if d in dims else kept.index(d)
        one = a.shape[d] == 1
        maps.append(IndexMap(0, tuple(int(i == place and not one) for i in range(width))))
    return maps


def index_text(offset: int, steps: Sequence[int], names: Sequence[str], base: int) -> str:
    """offset + base + sum of steps times variables; no steps: of an array without dimensions."""
    parts = []
    for step, name in zip(steps, names, strict=bool(steps)):
        if step:
            parts.append(name if step == 1 else f"{step} * {name}")
    if offset + base or not parts:
        parts.append(str(offset + base))
    return " + ".join(parts)
