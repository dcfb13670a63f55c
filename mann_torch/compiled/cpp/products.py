"""C++ text of products of matrices and vectors: y_i = sum over j of W_ij x_j.

Several results at a time stay in registers: a number of W that all samples share is spread to all
lanes as it is read, one of x is read once for all of them, and no sum waits for its own last
addition.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..graph.nodes import IndexMap, Node
from .homes import at, home_of
from .indices import composed, index_text, linear, reduced_maps

if TYPE_CHECKING:
    from .writer import Writer

#: Results at a time; so many results, and terms, are worth it where no factor is shared.
BLOCK, MANY, LONG = 8, 9, 16


def is_product(node: Node, stored: set[int]) -> bool:
    """Whether a stored node is a sum of products, written out, that is better taken in blocks."""
    if node.op != "sum" or node.kind != "f" or node.size == 1:
        return False
    (a,) = node.args
    if a.op != "mul" or a.number in stored:
        return False
    return any(map(_is_shared, a.args)) or (node.size >= MANY and a.size >= LONG * node.size)


def _is_shared(x: Node) -> bool:
    while x.op in ("view", "reshape"):
        x = x.args[0]
    return x.op == "input" and x.attributes[0] == "shared"


def write_product(w: Writer, node: Node) -> None:
    """Loops over the results, `BLOCK` of a dimension at a time."""
    home = home_of(w, node)
    moving = [d for d, n in enumerate(node.shape) if n != 1]
    names = [f"i{d}" for d in moving]
    along = _along(node, moving)
    count = node.shape[moving[along]]
    for k, d in enumerate(moving):
        if k != along:
            w.open(names[k], node.shape[d])
    whole = count - count % BLOCK
    maps = [IndexMap(0, tuple(int(d == m) for m in moving)) for d in range(len(node.shape))]
    if whole:
        w.open(names[along], whole, BLOCK)
        _block(w, node, home, names, _moved(maps, moving[along], BLOCK, 0))
        w.close()
    if count - whole:
        fixed = [
            IndexMap(m.offset, tuple(s * (k != along) for k, s in enumerate(m.steps))) for m in maps
        ]
        w.put("{")
        _block(w, node, home, names, _moved(fixed, moving[along], count - whole, whole))
        w.put("}")
    for _ in range(len(moving) - 1):
        w.close()


def _moved(maps: list[IndexMap], d: int, count: int, first: int) -> list[list[IndexMap]]:
    """Indices of each result of a block."""
    found = []
    for u in range(count):
        own = [*maps]
        own[d] = IndexMap(first + u, maps[d].steps)
        found.append(own)
    return found


def _along(node: Node, moving: Sequence[int]) -> int:
    """The dimension along which a block reads least."""
    (a,) = node.args
    inner = reduced_maps(node)

    def reads(k: int) -> tuple[float, int]:
        size = min(node.shape[moving[k]], BLOCK)
        each = [size if _depends(x, inner, moving[k], node) else 1 for x in a.args]
        return sum(each) / size, -k

    return min(range(len(moving)), key=reads)


def _depends(x: Node, inner: Sequence[IndexMap], d: int, node: Node) -> bool:
    """Whether an operand differs along a dimension of the result."""
    maps = list(inner)
    while x.op == "view":
        maps = [composed(m, maps) for m in x.attributes]
        x = x.args[0]
    return any(m.steps[d] for m in maps) if maps else False


def _block(
    w: Writer,
    node: Node,
    home: tuple[str, int],
    names: Sequence[str],
    blocks: Sequence[Sequence[IndexMap]],
) -> None:
    (a,) = node.args
    counts = [a.shape[d] for d in node.attributes]
    inner = [f"r{k}" for k in range(len(counts))]
    variables = [*names, *inner]
    sums = [f"s{node.number}_{u}" for u in range(len(blocks))]
    w.put(f"V {', '.join(f'{s} = splat(0.0)' for s in sums)};")
    for name, count in zip(inner, counts, strict=True):
        w.open(name, count)
    for s, maps in zip(sums, blocks, strict=True):
        outer = [IndexMap(m.offset, m.steps + (0,) * len(inner)) for m in maps]
        outer += [
            IndexMap(0, (0,) * len(names) + tuple(int(k == j) for j in range(len(inner))))
            for k in range(len(inner))
        ]
        found = [composed(m, outer) for m in reduced_maps(node)]
        left, right = (w.read(x, variables, found) for x in a.args)
        w.put(f"{s} = fma({left}, {right}, {s});")
    for _ in inner:
        w.close()
    for s, maps in zip(sums, blocks, strict=True):
        w.put(f"{at(home, index_text(*linear(maps, node.shape), names, 0))} = {s};")
