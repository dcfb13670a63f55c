"""Views, reshapes and concatenations: which index of a source an element comes from.

Concatenations vanish where they are taken apart again: a view that reads one piece of a `cat`
reads that piece, and a view of a pointwise operation on concatenations becomes the operation on
their pieces. That is how packing a state into a vector, and unpacking it, costs nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from .nodes import Graph, IndexMap, Node, Shape, identity_maps

#: A view is pushed through no more operations than this: Python's stack is finite.
_DEEP = 80


def view(g: Graph, x: Node, shape: Sequence[int], maps: Sequence[IndexMap]) -> Node:
    """Element i of the result (*shape) is the element of x that `maps` (one a dimension) say."""
    shape = tuple(shape)
    # A dimension of one element has no index to speak of.
    maps = tuple(
        IndexMap(m.offset, tuple(s if shape[i] != 1 else 0 for i, s in enumerate(m.steps)))
        for m in maps
    )
    if shape == x.shape and maps == identity_maps(x.shape):
        return x
    if x.op == "full":
        return g.node("full", (), shape, x.kind, x.attributes)
    if x.op == "view":
        return view(g, x.args[0], shape, [_through(m, maps, shape) for m in x.attributes])
    if x.op == "cat" or (is_pointwise(x) and _cuts_through(g, x, shape, maps)):
        return _pushed(g, x, shape, maps)
    return g.node("view", (x,), shape, x.kind, maps)


def _pushed(g: Graph, x: Node, shape: Shape, maps: tuple[IndexMap, ...]) -> Node:
    """A view of pieces, or of a pointwise operation's operands; once for each, and not too deep."""
    key = (x.number, shape, maps)
    found = g.pushed.get(key)
    if found is None:
        if g.depth < _DEEP:
            g.depth += 1
            if x.op == "cat":
                found = _of_pieces(g, x, shape, maps)
            else:
                found = rebuilt(g, x, [view(g, a, shape, maps) for a in x.args], shape)
            g.depth -= 1
        if found is None:
            found = g.node("view", (x,), shape, x.kind, maps)
        g.pushed[key] = found
    return found


def rebuilt(g: Graph, x: Node, args: Sequence[Node], shape: Shape) -> Node:
    """The pointwise operation of x on other operands."""
    from .arithmetic import pointwise

    return pointwise(g, x.op, args, x.kind, x.attributes, shape)


def is_pointwise(x: Node) -> bool:
    """Whether each element needs just the same element of every operand."""
    from .arithmetic import POINTWISE

    return x.op in POINTWISE


def _through(inner: IndexMap, outer: Sequence[IndexMap], shape: Shape) -> IndexMap:
    offset = inner.offset + sum(s * m.offset for s, m in zip(inner.steps, outer, strict=True))
    steps = tuple(
        sum(s * m.steps[i] for s, m in zip(inner.steps, outer, strict=True))
        for i in range(len(shape))
    )
    return IndexMap(offset, steps)


def span(m: IndexMap, shape: Shape) -> tuple[int, int]:
    """Least and greatest index that a map reaches."""
    ends = [s * (n - 1) for s, n in zip(m.steps, shape, strict=True)]
    return m.offset + sum(min(e, 0) for e in ends), m.offset + sum(max(e, 0) for e in ends)


def cuts(g: Graph, x: Node) -> dict[int, frozenset[int]]:
    """Where a concatenation, or a pointwise operation on some, can be cut, by dimension."""
    waiting = [x]
    while waiting:  # operands first
        top = waiting[-1]
        open_ = [a for a in _cut_operands(top) if a.number not in g.cuts]
        if top.number in g.cuts or not open_:
            waiting.pop()
            g.cuts[top.number] = _own_cuts(g, top)
        waiting += open_
    return g.cuts[x.number]


def _cut_operands(x: Node) -> tuple[Node, ...]:
    return x.args if x.op == "view" or is_pointwise(x) else ()


def _own_cuts(g: Graph, x: Node) -> dict[int, frozenset[int]]:
    """The cuts of a node whose operands' are known."""
    found: dict[int, frozenset[int]] = {}
    if x.op == "cat":
        (dim,) = x.attributes
        ends = itertools.accumulate(piece.shape[dim] for piece in x.args)
        return {dim: frozenset(list(ends)[:-1])}
    if x.op == "view":
        for dim, places in g.cuts[x.args[0].number].items():
            m = x.attributes[dim]
            moving = [i for i, s in enumerate(m.steps) if s]
            if len(moving) == 1 and m.steps[moving[0]] == 1:
                (i,) = moving
                inside = {p - m.offset for p in places if 0 < p - m.offset < x.shape[i]}
                if inside:
                    found[i] = frozenset(inside)
    elif is_pointwise(x):
        for a in x.args:
            for dim, places in g.cuts[a.number].items():
                found[dim] = found.get(dim, frozenset()) | places
    return found


def _cuts_through(g: Graph, x: Node, shape: Shape, maps: Sequence[IndexMap]) -> bool:
    """Whether a view leaves out a piece of some concatenation below x."""
    if 0 in shape:
        return False
    for dim, places in cuts(g, x).items():
        low, high = span(maps[dim], shape)
        if any(p <= low or p > high for p in places):
            return True
    return False


def _of_pieces(g: Graph, x: Node, shape: Shape, maps: Sequence[IndexMap]) -> Node | None:
    (dim,) = x.attributes
    if 0 in shape:
        return None
    m = maps[dim]
    low, high = span(m, shape)
    starts = [0, *itertools.accumulate(piece.shape[dim] for piece in x.args)]
    for start, end, piece in zip(starts[:-1], starts[1:], x.args, strict=True):
        if start <= low and high < end:
            moved = [*maps]
            moved[dim] = IndexMap(m.offset - start, m.steps)
            return view(g, piece, shape, moved)
    moving = [i for i, s in enumerate(m.steps) if s]
    if len(moving) != 1 or m.steps[moving[0]] != 1:
        return None
    (out,) = moving
    if any(other.steps[out] for d, other in enumerate(maps) if d != dim):
        return None
    parts = []
    for start, end, piece in zip(starts[:-1], starts[1:], x.args, strict=True):
        first, last = max(start, low), min(end, high + 1)
        if first < last:
            moved = [*maps]
            moved[dim] = IndexMap(first - start, m.steps)
            own = (*shape[:out], last - first, *shape[out + 1 :])
            parts.append(view(g, piece, own, moved))
    return cat(g, parts, out)


def cat(g: Graph, parts: Sequence[Node], dim: int) -> Node:
    """Pieces one after the other along a dimension."""
    flat: list[Node] = []
    for part in parts:
        inner = part.op == "cat" and part.attributes == (dim,)
        flat += part.args if inner else [part]
    kept = [part for part in flat if part.shape[dim]]
    if not kept:
        return flat[0]
    merged = [kept[0]]
    for part in kept[1:]:
        last = merged[-1]
        if last.op == part.op == "full" and last.attributes == part.attributes:
            joined = [*last.shape]
            joined[dim] += part.shape[dim]
            merged[-1] = g.node("full", (), joined, last.kind, last.attributes)
        else:
            merged.append(part)
    if len(merged) == 1:
        return merged[0]
    whole = _rejoined(g, merged, dim)
    if whole is not None:
        return whole
    shape = [*merged[0].shape]
    shape[dim] = sum(part.shape[dim] for part in merged)
    return g.node("cat", merged, shape, merged[0].kind, (dim,))


def _rejoined(g: Graph, parts: Sequence[Node], dim: int) -> Node | None:
    """The value whose consecutive slices the parts are, if they make up all of it."""
    sources = {id(part.args[0]) if part.op == "view" else None for part in parts}
    if len(sources) != 1 or None in sources:
        return None
    source = parts[0].args[0]
    total = sum(part.shape[dim] for part in parts)
    if len(source.shape) != len(parts[0].shape) or source.shape[dim] != total:
        return None
    start = 0
    for part in parts:
        if _slice_maps(part.shape, dim, start) != part.attributes:
            return None
        start += part.shape[dim]
    same = all(source.shape[d] == parts[0].shape[d] for d in range(len(source.shape)) if d != dim)
    return source if same else None


def _slice_maps(shape: Shape, dim: int, start: int) -> tuple[IndexMap, ...]:
    maps = [*identity_maps(shape)]
    maps[dim] = IndexMap(start, maps[dim].steps)
    return tuple(maps)
