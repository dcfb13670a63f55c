"""What is computed where: which nodes get a buffer, which loops they share, which buffers too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ..arithmetic import POINTWISE
from ..graph import IndexMap, Node, Shape, identity_maps, reachable, strides_of

#: Read where they are needed, without a buffer of their own.
_FREE = ("input", "full", "iota", "table", "view", "reshape")
#: Operations that read an operand again and again.
_GREEDY = (
    "gather",
    "scatter",
    "scatter_add",
    "order",
    "cumsum",
    "cumprod",
    "lu",
    "lu_rows",
    "lu_sign",
    "lu_solve",
    "cholesky",
    "triangular",
    "cummax",
    "cummin",
    "reshape",
)
#: Operations over the elements of their result, which can share a loop with others.
_LOOPS = ("sum", "prod", "amax", "amin", "any", "all", "argmax", "argmin")
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


def squeezed(shape: Shape) -> Shape:
    """Without dimensions of one element."""
    return tuple(n for n in shape if n != 1)


def stored_nodes(order: Sequence[Node], outputs: Sequence[Node]) -> set[int]:
    """Nodes with a value of their own; the others are written out where they are read.

    A pointwise node read no more often than it has elements costs nothing there.
    """
    reads = dict.fromkeys((n.number for n in order), 0)
    kept = {n.number for n in outputs}
    for node in outputs:
        if node.op in _FREE:
            reads[node.number] += node.size
    stored: set[int] = set()
    for node in reversed(order):
        times = reads[node.number]
        if node.op in ("input", "full", "iota", "table"):
            continue
        if node.op in POINTWISE:
            if node.number in kept or times > node.size:
                stored.add(node.number)
                times = node.size
        elif node.op not in ("view", "reshape"):
            stored.add(node.number)
            times = node.size
        for a in node.args:
            if node.op in _GREEDY:
                reads[a.number] += 2 * a.size + 1
            elif node.op in _LOOPS or node.op == "cat":
                reads[a.number] += a.size
            else:
                reads[a.number] += times
    return stored


class Reads:
    """What each stored node reads, and whether element by element."""

    def __init__(self, order: Sequence[Node], stored: set[int]) -> None:
        self._stored = stored
        self.of = {n.number: self._reads(n) for n in order if n.number in stored}

    def below(self, x: Node) -> set[int]:
        """Numbers of the stored nodes that a node without a value of its own is made of."""
        found: dict[int, bool] = {}
        self._walk(x, identity_maps(x.shape), None, found)
        return set(found)

    def _reads(self, node: Node) -> dict[int, bool]:
        """Numbers of stored nodes read -> whether each only at the element that is computed."""
        found: dict[int, bool] = {}
        # A dimension of one element has no index.
        own = linear(identity_maps(node.shape), node.shape)[1]
        if node.op in POINTWISE:
            for a in node.args:
                self._walk(a, identity_maps(node.shape), own, found)
        elif node.op in _LOOPS:
            (a,) = node.args
            self._walk(a, reduced_maps(node), own + (0,) * len(node.attributes), found)
        else:
            for a in node.args:
                self._walk(a, identity_maps(a.shape), None, found)
        return found

    def _walk(
        self,
        x: Node,
        maps: Sequence[IndexMap],
        own: Shape | None,
        found: dict[int, bool],
    ) -> None:
        if x.number in self._stored:
            found[x.number] = found.get(x.number, True) and _is_own(maps, x.shape, own)
        elif x.op == "view":
            self._walk(x.args[0], [composed(m, maps) for m in x.attributes], own, found)
        elif x.op == "reshape":
            source = x.args[0]
            if source.number in self._stored:
                same = _is_own(maps, x.shape, own)
                found[source.number] = found.get(source.number, True) and same
        elif x.op in POINTWISE:
            for a in x.args:
                self._walk(a, maps, own, found)


def _is_own(maps: Sequence[IndexMap], shape: Shape, own: Shape | None) -> bool:
    """Whether maps reach the very element that is being computed, of linear index `own`."""
    return own is not None and linear(maps, shape) == (0, own)


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


def make_plan(outputs: Sequence[Output]) -> Plan:
    """A schedule: scalars as soon as they can be, and loops with as much in them as fits."""
    results = [o.node for o in outputs]
    order = reachable(results)
    stored = stored_nodes(order, results)
    units = [n for n in order if n.number in stored]
    reads = Reads(order, stored)
    groups = _grouped(units, reads)
    return _housed(groups, reads, outputs)


def _grouped(units: list[Node], reads: Reads) -> list[Group]:
    done: set[int] = set()
    left, groups = units, []
    while left:
        scalars = [
            n for n in left if n.size == 1 and _shares(n) and done >= reads.of[n.number].keys()
        ]
        if scalars:
            groups.append(Group((), scalars))
            done.update(n.number for n in scalars)
            left = [n for n in left if n.number not in done]
            continue
        first = next(n for n in left if done >= reads.of[n.number].keys())
        group = Group(squeezed(first.shape))
        if _shares(first):
            _fill(group, left, reads, done)
        else:
            group.nodes.append(first)
        groups.append(group)
        done.update(n.number for n in group.nodes)
        left = [n for n in left if n.number not in done]
    return groups


def _shares(node: Node) -> bool:
    return node.op in POINTWISE or node.op in _LOOPS


def _fill(group: Group, left: list[Node], reads: Reads, done: set[int]) -> None:
    """Every node of this shape that reads finished values, or the loop's own element by element."""
    inside: set[int] = set()
    for node in left:
        if len(group.nodes) >= _CROWD:
            break
        if not _shares(node) or squeezed(node.shape) != group.shape:
            continue
        if all(n in done or (n in inside and same) for n, same in reads.of[node.number].items()):
            group.nodes.append(node)
            inside.add(node.number)


def _housed(groups: list[Group], reads: Reads, outputs: Sequence[Output]) -> Plan:
    """Results go straight to where they are wanted; other arrays are used again once free."""
    place_of: dict[int, int] = {}
    last: dict[int, int] = {}
    for place, group in enumerate(groups):
        for node in group.nodes:
            place_of[node.number] = last[node.number] = place
            for number in reads.of[node.number]:
                last[number] = max(last[number], place)
    homes: dict[int, tuple[str, int]] = {}
    for output in outputs:
        number = output.node.number
        if number in place_of and number not in homes:
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
            if last[number] == place and _shares(node):
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
    return Plan(groups, homes, arrays, passing)
