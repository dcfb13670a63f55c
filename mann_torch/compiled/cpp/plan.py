"""What is computed where: which nodes get a buffer, which loops they share, which buffers too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ..graph.arithmetic import POINTWISE
from ..graph.nodes import Node, Shape, reachable
from .products import is_product
from .reads import LOOPS, Reads, stored_nodes

#: The array of the caller that results are added to.
SUMS = "g_shared"
#: No more statements than this in one loop.
_CROWD = 40


class Output(NamedTuple):
    """Where a result goes: an array of the caller, and where in it."""

    node: Node
    place: str
    offset: int


@dataclass
class Group:
    """Nodes computed in one loop over a common shape, or one node that has loops of its own."""

    shape: Shape
    nodes: list[Node] = field(default_factory=list)


@dataclass
class Plan:
    """Groups in order, and the array that holds each node."""

    groups: list[Group]
    #: Node number -> (array, offset) or, of one element, a variable's name.
    homes: dict[int, tuple[str, int]]
    #: Array -> number of elements and kind.
    arrays: dict[str, tuple[int, str]]
    #: Nodes that only their own group reads: no buffer is written.
    passing: set[int]
    #: Nodes with a loop of their own: products of matrices.
    products: set[int]


def squeezed(shape: Shape) -> Shape:
    """Without dimensions of one element."""
    return tuple(n for n in shape if n != 1)


def make_plan(outputs: Sequence[Output], blocks: bool = False) -> Plan:
    """A schedule: scalars as soon as they can be, and loops with as much in them as fits.

    With `blocks`, products of matrices have loops of their own.
    """
    results = [o.node for o in outputs]
    order = reachable(results)
    stored = stored_nodes(order, results)
    units = [n for n in order if n.number in stored]
    reads = Reads(order, stored)
    products = {n.number for n in units if blocks and is_product(n, stored)}
    groups = _grouped(units, reads, products)
    return _housed(groups, reads, outputs, products)


def _grouped(units: list[Node], reads: Reads, products: set[int]) -> list[Group]:
    done: set[int] = set()
    left, groups = units, []
    while left:
        scalars = [
            n
            for n in left
            if n.size == 1 and _shares(n, products) and done >= reads.of[n.number].keys()
        ]
        if scalars:
            groups.append(Group((), scalars))
            done.update(n.number for n in scalars)
            left = [n for n in left if n.number not in done]
            continue
        first = next(n for n in left if done >= reads.of[n.number].keys())
        group = Group(squeezed(first.shape))
        if _shares(first, products):
            _fill(group, left, reads, done, products)
        else:
            group.nodes.append(first)
        groups.append(group)
        done.update(n.number for n in group.nodes)
        left = [n for n in left if n.number not in done]
    return groups


def _shares(node: Node, products: set[int]) -> bool:
    return (node.op in POINTWISE or node.op in LOOPS) and node.number not in products


def _fill(group: Group, left: list[Node], reads: Reads, done: set[int], products: set[int]) -> None:
    """Every node of this shape that reads finished values, or the loop's own element by element."""
    inside: set[int] = set()
    for node in left:
        if len(group.nodes) >= _CROWD:
            break
        if not _shares(node, products) or squeezed(node.shape) != group.shape:
            continue
        if all(n in done or (n in inside and same) for n, same in reads.of[node.number].items()):
            group.nodes.append(node)
            inside.add(node.number)


def _housed(
    groups: list[Group], reads: Reads, outputs: Sequence[Output], products: set[int]
) -> Plan:
    """Results go straight to where they are wanted; other arrays are used again once free.

    What is added to a sum goes there if nobody else reads it.
    """
    place_of: dict[int, int] = {}
    last: dict[int, int] = {}
    for place, group in enumerate(groups):
        for node in group.nodes:
            place_of[node.number] = last[node.number] = place
            for number in reads.of[node.number]:
                last[number] = max(last[number], place)
    homes: dict[int, tuple[str, int]] = {}
    uses = Counter([n for n in place_of for n in reads.of[n]] + [o.node.number for o in outputs])
    for output in outputs:
        number = output.node.number
        added = output.place == SUMS
        if added and (uses[number] > 1 or not _shares(output.node, products)):
            pass
        elif number in place_of and number not in homes:
            homes[number] = (output.place, output.offset)
        if number in place_of:
            last[number] = len(groups)  # it may be copied to another place too
        else:
            for below in reads.below(output.node):
                last[below] = len(groups)
    arrays: dict[str, tuple[int, str]] = {}
    free: dict[tuple[int, str], list[str]] = {}
    ends: dict[int, list[tuple[int, str]]] = {}
    passing: set[int] = set()
    for place, group in enumerate(groups):
        for node in group.nodes:
            number = node.number
            if node.size == 1 or number in homes:
                continue
            if last[number] == place and _shares(node, products):
                passing.add(number)
                continue
            key = (node.size, "f" if node.kind == "f" else "i")
            stock = free.setdefault(key, [])
            name = stock.pop() if stock else f"b{len(arrays)}"
            arrays[name] = key
            homes[number] = (name, 0)
            ends.setdefault(last[number], []).append((number, name))
        for _, name in ends.get(place, []):
            free[arrays[name]].append(name)
    return Plan(groups, homes, arrays, passing, products)
