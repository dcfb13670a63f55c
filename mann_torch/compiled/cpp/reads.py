"""What is computed where it is read, and what has a value of its own."""

from __future__ import annotations

from collections.abc import Sequence

from ..graph.arithmetic import POINTWISE
from ..graph.nodes import IndexMap, Node, Shape, identity_maps
from .indices import composed, linear, reduced_maps

#: Read where they are needed, without a buffer of their own.
FREE = ("input", "full", "iota", "table", "view", "reshape")
#: Operations that read an operand again and again.
GREEDY = (
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
    "matrix_exp",
    "cummax",
    "cummin",
    "reshape",
)
#: Operations over the elements of their result, which can share a loop with others.
LOOPS = ("sum", "prod", "amax", "amin", "any", "all", "argmax", "argmin")


#: Terms that an expression may have; nested so deep, it is cut whatever that costs; and terms in
#: all the places where it is written out.
_LONG, _DEEP, _COPIES = 48, 64, 128


def stored_nodes(order: Sequence[Node], outputs: Sequence[Node]) -> set[int]:
    """Nodes with a value of their own; the others are written out where they are read.

    A pointwise node read no more often than it has elements costs nothing there.
    """
    reads = dict.fromkeys((n.number for n in order), 0)
    places = dict.fromkeys(reads, 0)  # in the text
    kept = {n.number for n in outputs}
    for node in outputs:
        if node.op in FREE:
            reads[node.number] += node.size
            places[node.number] += 1
    stored: set[int] = set()
    for node in reversed(order):
        times, here = reads[node.number], places[node.number]
        if node.op in ("input", "full", "iota", "table"):
            continue
        if node.op in POINTWISE:
            if node.number in kept or times > node.size:
                stored.add(node.number)
        elif node.op not in ("view", "reshape"):
            stored.add(node.number)
        if node.number in stored:
            times, here = node.size, 1
        for a in node.args:
            places[a.number] += here
            if node.op in GREEDY:
                reads[a.number] += 2 * a.size + 1
            elif node.op in LOOPS or node.op == "cat":
                reads[a.number] += a.size
            else:
                reads[a.number] += times
    return stored | _bulky(order, stored, reads, places)


def _bulky(
    order: Sequence[Node], stored: set[int], reads: dict[int, int], places: dict[int, int]
) -> set[int]:
    """Nodes to store because their text would be long, or long and written often."""
    found: set[int] = set()
    terms, depth = dict.fromkeys(reads, 0), dict.fromkeys(reads, 0)
    for node in order:
        number = node.number
        if number in stored or not node.args:
            continue
        terms[number] = sum(terms[a.number] for a in node.args) + (node.op in POINTWISE)
        depth[number] = max(depth[a.number] for a in node.args) + 1
        if node.op not in POINTWISE:
            continue
        count = terms[number]
        costly = count > _LONG or (places[number] > 1 and count * places[number] > _COPIES)
        if depth[number] > _DEEP or (costly and 2 * reads[number] >= node.size):
            found.add(number)
            terms[number] = depth[number] = 0
    return found


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
        elif node.op in LOOPS:
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
