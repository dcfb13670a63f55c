"""Sums of outer products: what each step adds to the gradient of a weight matrix.

A step keeps the two factors. Those of several steps are added at a time, with a tile of the sums
in registers: reading and writing all of them in each step would cost more than the products.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..graph.arithmetic import POINTWISE
from ..graph.nodes import Graph, IndexMap, Node, identity_maps
from ..graph.views import view
from .indices import composed
from .plan import SUMS, Output

#: The array of the caller that factors are written to, and the steps whose factors it holds.
KEPT, KEEP = "kept", 4
#: Sums that are worth it; so many products a step may add to each at most.
_LEAST, _MOST = 256, 4


class Outer(NamedTuple):
    """A matrix of sums, and where the factors of what is added to it lie among those kept."""

    sums: int
    rows: int
    columns: int
    terms: tuple[tuple[int, int], ...]  # of a step: left, right


class Outers(NamedTuple):
    """All of them, and the vectors that a step keeps."""

    products: tuple[Outer, ...] = ()
    width: int = 0


def with_factors(g: Graph, outputs: Sequence[Output]) -> tuple[list[Output], Outers]:
    """The outputs, with factors in the place of large outer products."""
    others, found = [], []
    places: dict[int, Output] = {}
    width = 0
    for output in outputs:
        terms = _terms(g, output.node) if output.place == SUMS else None
        if terms is None:
            others.append(output)
            continue
        for x in (x for term in terms for x in term):
            if x.number not in places:
                places[x.number] = Output(x, KEPT, width)
                width += x.size
        (rows, columns), *_ = [(a.size, b.size) for a, b in terms]
        kept = tuple((places[a.number].offset, places[b.number].offset) for a, b in terms)
        found.append(Outer(output.offset, rows, columns, kept))
    return [*others, *places.values()], Outers(tuple(found), width)


def _terms(g: Graph, x: Node) -> list[tuple[Node, Node]] | None:
    """Pairs of vectors a (n,), b (m,) whose outer products x is the sum of."""
    moving = [d for d, n in enumerate(x.shape) if n != 1]
    if len(moving) != 2 or x.size < _LEAST:
        return None
    found: list[tuple[Node, Node]] = []
    waiting = [x]
    while waiting:
        node = waiting.pop()
        source = node.args[0] if node.op == "view" else node
        if source.op not in ("add", "mul") or len(found) + len(waiting) > _MOST:
            return None
        a, b = (
            view(g, y, node.shape, node.attributes) if node.op == "view" else y for y in source.args
        )
        if source.op == "add":
            waiting += [b, a]
            continue
        pair = _pair(g, a, b, *moving)
        if pair is None:
            return None
        found.append(pair)
    return found


def _pair(g: Graph, a: Node, b: Node, row: int, column: int) -> tuple[Node, Node] | None:
    for left, right in ((a, b), (b, a)):
        if not _depends(left, column) and not _depends(right, row):
            return _along(g, left, row), _along(g, right, column)
    return None


def _depends(x: Node, d: int) -> bool:
    """Whether an element differs along a dimension, for all that can be told."""
    waiting = [(x, list(identity_maps(x.shape)))]
    seen: set[tuple[int, tuple[IndexMap, ...]]] = set()
    while waiting:
        node, maps = waiting.pop()
        if not maps or (node.number, tuple(maps)) in seen:
            continue  # one element, or known
        seen.add((node.number, tuple(maps)))
        if node.op == "view":
            waiting.append((node.args[0], [composed(m, maps) for m in node.attributes]))
        elif node.op in POINTWISE:
            waiting += [(a, maps) for a in node.args]
        elif node.op != "full" and any(m.steps[d] for m in maps):
            return True
    return False


def _along(g: Graph, x: Node, d: int) -> Node:
    maps = [IndexMap(0, (int(k == d),)) for k in range(len(x.shape))]
    return view(g, x, (x.shape[d],), maps)


def outer_text(outers: Outers, sums: int, tile: tuple[int, int]) -> str:
    """The struct `Outer`: `add` of what is kept, and all else that goes to the sums."""
    sizes: set[tuple[int, int, int]] = set()
    calls: list[str] = []
    for product in outers.products:
        calls += _calls(product, tile, sizes)
    tiles = "".join(_tile(*size) for size in sorted(sizes))
    rest = _rest(outers, sums)
    copied = "".join(f"    for (int e = {a}; e < {b}; ++e) to[e] = from[e];\n" for a, b in rest)
    held = "".join(
        f"    for (int e = {a}; e < {b}; ++e) to[e] = sel(alive, from[e], to[e]);\n"
        for a, b in rest
    )
    return f"""
struct Outer : Lanes {{
  static inline CUDA_CALLABLE void copy(V* to, const V* from) {{
{copied}  }}
  static inline CUDA_CALLABLE void hold(M alive, V* to, const V* from) {{
{held}  }}
{tiles}  // The factors of `count` steps, one after the other.
  static CUDA_CALLABLE void add(V* sums, const V* kept, int count) {{
{"".join(f"    {call}" + chr(10) for call in calls)}  }}
}};
"""


def _rest(outers: Outers, sums: int) -> list[tuple[int, int]]:
    """Ranges of the sums that are no outer products'."""
    found, start = [], 0
    for product in sorted(outers.products):
        found.append((start, product.sums))
        start = product.sums + product.rows * product.columns
    return [(a, b) for a, b in [*found, (start, sums)] if a < b]


def _calls(p: Outer, tile: tuple[int, int], sizes: set[tuple[int, int, int]]) -> list[str]:
    lines = []
    for i, (height, end) in _steps(p.rows, tile[0], "i"):
        for j, (width, stop) in _steps(p.columns, tile[1], "j"):
            sizes.add((height, width, len(p.terms)))
            where = f"sums + {p.sums} + {i} * {p.columns} + {j}, {p.columns}"
            kept = [f"kept + {left} + {i}, kept + {right} + {j}" for left, right in p.terms]
            name = f"tile_{height}_{width}_{len(p.terms)}"
            lines.append(f"{end}{stop}{name}({where}, {', '.join(kept)}, count);")
    return lines


def _steps(count: int, size: int, name: str) -> list[tuple[str, tuple[int, str]]]:
    """The index, size and loop of whole tiles along a dimension, and of what is left."""
    whole, found = count - count % size, []
    if whole:
        loop = f"for (int {name} = 0; {name} < {whole}; {name} += {size}) "
        found.append((name, (size, loop)))
    if count - whole:
        found.append((str(whole), (count - whole, "")))
    return found


def _tile(rows: int, columns: int, terms: int) -> str:
    cells = [(i, j) for i in range(rows) for j in range(columns)]
    load = "\n".join(f"    V s{i}_{j} = sums[{i} * stride + {j}];" for i, j in cells)
    store = "\n".join(f"    sums[{i} * stride + {j}] = s{i}_{j};" for i, j in cells)
    inner = []
    for k in range(terms):
        read = [f"const V a{i} = left_{k}[{i}];" for i in range(rows)]
        read += [f"const V b{j} = right_{k}[{j}];" for j in range(columns)]
        inner.append(f"      {{ {' '.join(read)}")
        inner += [f"        s{i}_{j} = fma(a{i}, b{j}, s{i}_{j});" for i, j in cells]
        inner.append(f"      }} left_{k} += N_KEPT; right_{k} += N_KEPT;")
    given = ", ".join(f"const V* left_{k}, const V* right_{k}" for k in range(terms))
    return f"""  static inline CUDA_CALLABLE void tile_{rows}_{columns}_{terms}(
      V* __restrict__ sums, int stride, {given}, int count) {{
{load}
    for (int s = 0; s < count; ++s) {{
{chr(10).join(inner)}
    }}
{store}
  }}
"""
