"""C++ text of reductions: one element of the result at a time, inside the loop that wants it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..graph.nodes import IndexMap, Node
from .expressions import type_of
from .indices import composed, reduced_maps

if TYPE_CHECKING:
    from .writer import Writer

#: A sum of this many terms to few results is split over several accumulators.
_LONG = 16
_FEW = 8


_REDUCE = {
    ("sum", "f"): ("splat(0.0)", "({0} + {1})"),
    ("sum", "i"): ("isplat(0)", "iadd({0}, {1})"),
    ("prod", "f"): ("splat(1.0)", "({0} * {1})"),
    ("prod", "i"): ("isplat(1)", "imul({0}, {1})"),
    ("amax", "f"): ("(-inf_())", "max_({0}, {1})"),
    ("amin", "f"): ("inf_()", "min_({0}, {1})"),
    ("amax", "i"): ("isplat(-MOSTll)", "imax({0}, {1})"),
    ("amin", "i"): ("isplat(MOSTll)", "imin({0}, {1})"),
    ("amax", "b"): ("isplat(0)", "({0} | {1})"),
    ("amin", "b"): ("isplat(-1)", "({0} & {1})"),
    ("any", "b"): ("isplat(0)", "({0} | {1})"),
    ("all", "b"): ("isplat(-1)", "({0} & {1})"),
}


def write_reduction(
    w: Writer, node: Node, name: str, names: Sequence[str], maps: Sequence[IndexMap]
) -> None:
    (a,) = node.args
    counts = [a.shape[d] for d in node.attributes]
    inner = [f"r{node.number}_{k}" for k in range(len(counts))]
    variables = [*names, *inner]
    outer = [IndexMap(m.offset, m.steps + (0,) * len(inner)) for m in maps]
    outer += [
        IndexMap(0, (0,) * len(names) + tuple(int(k == j) for j in range(len(inner))))
        for k in range(len(inner))
    ]
    found = [composed(m, outer) for m in reduced_maps(node)]
    if node.op in ("argmax", "argmin"):
        _arg_reduction(w, node, name, variables, inner[0], counts[0], found)
        return
    start, step = _REDUCE[node.op, node.kind if node.kind != "b" else "b"]
    start = start.replace("MOST", str(2 ** (8 * w.real.bytes - 1) - 1))
    long = node.op == "sum" and node.kind == "f" and math.prod(counts) >= _LONG
    if long and node.size <= _FEW and max(counts) >= 4:
        _long_sum(w, node, name, variables, inner, counts, found)
        return
    w.put(f"{name} = {start};")
    for variable, count in zip(inner, counts, strict=True):
        w.open(variable, count)
    w.put(_accumulate(w, node, name, variables, found, step))
    for _ in inner:
        w.close()


def _accumulate(
    w: Writer, node: Node, name: str, names: Sequence[str], maps: Sequence[IndexMap], step: str
) -> str:
    (a,) = node.args
    if node.op == "sum" and node.kind == "f" and w.is_inline_product(a):
        left, right = (w.read(p, names, maps) for p in a.args)
        return f"{name} = fma({left}, {right}, {name});"
    return f"{name} = {step.format(name, w.read(a, names, maps))};"


def _long_sum(
    w: Writer,
    node: Node,
    name: str,
    names: Sequence[str],
    inner: Sequence[str],
    counts: Sequence[int],
    maps: Sequence[IndexMap],
) -> None:
    """Several sums side by side: one alone would wait for each addition."""
    along = max(range(len(counts)), key=lambda k: (counts[k], k))
    last, count = inner[along], counts[along]
    width = 8 if count >= 8 else 4
    parts = [f"{name}_{k}" for k in range(width)]
    w.put(f"V {' = splat(0.0), '.join(parts)} = splat(0.0);")
    others = [(v, n) for v, n in zip(inner, counts, strict=True) if v != last]
    for variable, n in others:
        w.open(variable, n)
    place = list(names).index(last)
    w.open(last, count, width)
    for k, part in enumerate(parts):
        moved = [IndexMap(m.offset + k * m.steps[place], m.steps) for m in maps]
        w.put(_accumulate(w, node, part, names, moved, "({0} + {1})"))
    w.close()
    for k, rest in enumerate(range(count - count % width, count)):
        fixed = [
            IndexMap(
                m.offset + rest * m.steps[place],
                tuple(0 if i == place else s for i, s in enumerate(m.steps)),
            )
            for m in maps
        ]
        w.put(_accumulate(w, node, parts[k], names, fixed, "({0} + {1})"))
    for _ in others:
        w.close()
    while len(parts) > 1:
        half = len(parts) // 2
        parts = [f"({a} + {b})" for a, b in zip(parts[:half], parts[half:], strict=True)]
    w.put(f"{name} = {parts[0]};")


def _arg_reduction(
    w: Writer,
    node: Node,
    name: str,
    names: Sequence[str],
    inner: str,
    count: int,
    maps: Sequence[IndexMap],
) -> None:
    (a,) = node.args
    kind, best, here = type_of(a.kind), f"{name}_best", f"{name}_here"
    place = list(names).index(inner)
    first = [
        IndexMap(m.offset, tuple(0 if i == place else s for i, s in enumerate(m.steps)))
        for m in maps
    ]
    w.put(f"{kind} {best} = {w.read(a, names, first)};")
    w.put(f"{name} = isplat(0);")
    w.open(inner, count)
    w.put(f"{kind} {here} = {w.read(a, names, maps)};")
    test = "gt" if node.op == "argmax" else "lt"
    if a.kind == "f":  # NaN comes first, as in torch
        better = f"({test}({here}, {best}) | (ne({here}, {here}) & eq({best}, {best})))"
        w.put(f"M {name}_take = {better};")
        w.put(f"{best} = sel({name}_take, {here}, {best});")
    else:
        w.put(f"M {name}_take = i{test}({here}, {best});")
        w.put(f"{best} = isel({name}_take, {here}, {best});")
    w.put(f"{name} = isel({name}_take, isplat({inner}), {name});")
    w.close()
