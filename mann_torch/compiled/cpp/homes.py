"""Where elements are: text of arrays, rows and places for what has loops of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..graph.nodes import IndexMap, Node
from .expressions import type_of
from .indices import index_text, linear

if TYPE_CHECKING:
    from .writer import Writer


def choose(kind: str) -> str:
    return "sel" if kind == "f" else "isel"


def home_of(w: Writer, node: Node) -> tuple[str, int]:
    """Where a node's elements are; of one element, in an array of its own for now."""
    home = w.plan.homes.get(node.number)
    if home is None:
        name = f"s{node.number}"
        w.put(f"{type_of(node.kind)} {name}[1];")
        home = w.plan.homes[node.number] = (name, 0)
    return home


def at(home: tuple[str, int], index: str) -> str:
    return f"{home[0]}[{home[1]} + {index}]" if home[1] else f"{home[0]}[{index}]"


def rows_of(node: Node) -> tuple[tuple[int, ...], int]:
    return node.shape[:-1], node.shape[-1]


def flat(shape: tuple[int, ...], names: list[str], maps: list[IndexMap], width: int) -> str:
    """Linear index of the first element of a row of `width`."""

    if not shape:
        return "0"
    offset, steps = linear(maps, shape)
    return f"({index_text(offset, steps, names, 0)}) * {width}"


def element(w: Writer, x: Node, names: list[str], maps: list[IndexMap], *last: str) -> str:
    """An element of x: leading indices as given, then loop variables."""
    count = len(last)
    outer = [IndexMap(m.offset, m.steps + (0,) * count) for m in maps]
    inner = [
        IndexMap(0, (0,) * len(names) + tuple(int(k == j) for j in range(count)))
        for k in range(count)
    ]
    return w.read(x, [*names, *last], outer + inner)
