"""The compiler's own graphs: values of one sample, made by constructors that simplify.

A node is an operation on nodes, interned: equal nodes are one object, which is what removes common
subexpressions. Nodes nobody reads are never emitted. Every operand of a pointwise operation has
the shape of its result: broadcasting is written out as views, which cost nothing.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

from ..real import DOUBLE, Real

Shape = tuple[int, ...]
#: Kinds of element: f floating, i integer, b bool.
KINDS = "fib"


class IndexMap(NamedTuple):
    """Index of one dimension of a source: offset + sum of steps times the view's own indices."""

    offset: int
    steps: tuple[int, ...]


class Node:
    """A value: operation, operands, shape, kind of element and attributes."""

    __slots__ = ("args", "attributes", "kind", "number", "op", "shape")

    def __init__(
        self, number: int, op: str, args: tuple[Node, ...], shape: Shape, kind: str, attributes: Any
    ) -> None:
        self.number, self.op, self.args = number, op, args
        self.shape, self.kind, self.attributes = shape, kind, attributes

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    def __repr__(self) -> str:
        names = ", ".join(f"%{a.number}" for a in self.args)
        return f"%{self.number} = {self.op}({names}) {self.attributes} {self.kind}{self.shape}"


class Graph:
    """Makes nodes, each once; constants are rounded to the arithmetic they are for."""

    def __init__(self, real: Real = DOUBLE) -> None:
        self.real = real
        self._known: dict[Hashable, Node] = {}
        #: Notes of `views`: views taken apart by what is viewed and how, and places of cuts by
        #: number; how many operations deep a view is being pushed now.
        self.pushed: dict[Hashable, Node] = {}
        self.cuts: dict[int, dict[int, frozenset[int]]] = {}
        self.depth = 0

    def node(
        self, op: str, args: Sequence[Node], shape: Sequence[int], kind: str, attributes: Any = ()
    ) -> Node:
        """The node of this description, as it is: no simplification, but nothing is all alike."""
        if 0 in shape and op not in ("input", "full"):
            return self.full(0, shape, kind)
        key = (op, tuple(a.number for a in args), tuple(shape), kind, attributes)
        found = self._known.get(key)
        if found is None:
            found = Node(len(self._known), op, tuple(args), tuple(shape), kind, attributes)
            self._known[key] = found
        return found

    def forget(self) -> None:
        """Empty the notes."""
        self.pushed.clear()
        self.cuts.clear()

    def input(self, place: str, offset: int, shape: Sequence[int], kind: str) -> Node:
        """A value that comes in: `place` names an array of the caller, `offset` where in it."""
        return self.node("input", (), shape, kind, (place, offset))

    def full(self, value: float | int | bool, shape: Sequence[int], kind: str) -> Node:
        """One number everywhere."""
        number = self._held(value, kind)
        # -0.0 == 0.0 and True == 1: the text tells them apart.
        return self.node("full", (), shape, kind, (repr(number),))

    def _held(self, value: Any, kind: str) -> float | int | bool:
        """A number of a kind. Raises `NotImplementedError` for an integer of too many bits."""
        if kind == "f":
            return self.real.rounded(value)
        if kind == "i" and not self.real.holds(int(value)):
            raise NotImplementedError(f"{int(value)} beyond {8 * self.real.bytes} bits")
        return int(value) if kind == "i" else bool(value)

    def iota(self, start: int, step: int, count: int, kind: str = "i") -> Node:
        """start, start + step, ... (count,)."""
        return self.node("iota", (), (count,), kind, (start, step))

    def table(self, values: Sequence[Any], shape: Sequence[int], kind: str) -> Node:
        """Given numbers, in row-major order."""
        if len(values) and len({repr(v) for v in values}) == 1:
            return self.full(values[0], shape, kind)
        held = tuple(repr(self._held(v, kind)) for v in values)
        return self.node("table", (), shape, kind, held)


def number_of(node: Node) -> float | int | bool | None:
    """The number a constant holds everywhere; None if it is no such constant."""
    if node.op != "full":
        return None
    text = node.attributes[0]
    if node.kind == "f":
        return float(text)
    return text == "True" if node.kind == "b" else int(text)


def strides_of(shape: Shape) -> Shape:
    """Row-major strides."""
    strides, step = [], 1
    for size in reversed(shape):
        strides.append(step)
        step *= size
    return tuple(reversed(strides))


def identity_maps(shape: Shape) -> tuple[IndexMap, ...]:
    """Each dimension by its own index."""
    rank = len(shape)
    return tuple(
        IndexMap(0, tuple(int(i == d) for i in range(rank)))
        if shape[d] != 1
        # An index that is always 0.
        else IndexMap(0, (0,) * rank)
        for d in range(rank)
    )


def reachable(outputs: Sequence[Node]) -> list[Node]:
    """All nodes the outputs need, operands first."""
    order: list[Node] = []
    seen: set[int] = set()
    stack: list[tuple[Node, bool]] = [(node, False) for node in reversed(outputs)]
    while stack:
        node, done = stack.pop()
        if done:
            order.append(node)
        elif node.number not in seen:
            seen.add(node.number)
            stack.append((node, True))
            stack.extend((a, False) for a in reversed(node.args) if a.number not in seen)
    return order
