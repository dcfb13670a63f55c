"""Functions of a step's arguments, traced and lowered into one graph over one layout."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.fx import GraphModule

from ..cpp.plan import SUMS, Output
from ..graph.nodes import Graph, Node, number_of, reachable
from ..graph.reshapes import narrow
from ..graph.views import cuts
from ..lowering import lower
from ..trace.telling import UntraceableError
from ..trace.tracing import trace, trace_vjp
from .layout import Arguments, Layout, Leaf, offsets


class Own(NamedTuple):
    """An argument that a function takes besides the step's: where it lies, and an example."""

    place: str
    offset: int
    example: Tensor


class Result(NamedTuple):
    """Where a result goes: array, offset, and what it must be."""

    place: str
    offset: int
    leaf: Leaf


@dataclass(frozen=True)
class Piece:
    """A function (own, arguments) -> results of one sample's tensors."""

    function: Callable[[list[Tensor], Arguments], Sequence[Tensor]]
    results: tuple[Result, ...]
    own: tuple[Own, ...] = ()


class Back(NamedTuple):
    """What of a piece's gradient is wanted, besides that of the carry."""

    constants: tuple[int, ...] = ()  # numbered among those that are used
    segments: tuple[int, ...] = ()
    own: tuple[tuple[int, str], ...] = ()  # number of the argument, array of its gradient


class Scope:
    """Pieces that share a graph.

    `given` is the layout of all that they may take; constants that none reads are left out of
    `layout`, and `used` are the numbers of those that stay. `examples` are one sample's arguments.
    Raises `UntraceableError`.
    """

    def __init__(self, given: Layout, examples: Sequence[Tensor], pieces: Sequence[Piece]) -> None:
        self.given, self.examples = given, examples
        made = [trace(self._flat(p), [*_examples(p), *examples]) for p in pieces]
        #: How often each torch operation was met, by name.
        self.operations = Counter(name for m in made for name in _operations(m))
        self.used = self._constants_in(pieces, made)
        kept = tuple(given.constants[i] for i in self.used)
        self.layout = dataclasses.replace(given, constants=kept)
        self.graph = Graph(given.real)
        #: The outputs of each piece.
        self.outputs = [self._outputs(p, m) for p, m in zip(pieces, made, strict=True)]

    def _flat(self, piece: Piece) -> Callable[[Sequence[Tensor]], Sequence[Tensor]]:
        count = len(piece.own)
        return lambda flat: piece.function(list(flat[:count]), self.arguments(flat[count:]))

    def arguments(self, flat: Sequence[Tensor]) -> Arguments:
        """The step's arguments from one flat list."""
        given, parts, start = self.given, [], 0
        counts = (given.clock, len(given.constants), len(given.segments), len(given.noise))
        for count in (*counts, len(given.carry)):
            parts.append(list(flat[start : start + count]))
            start += count
        return Arguments(*parts)

    def _constants_in(
        self, pieces: Sequence[Piece], made: Sequence[GraphModule]
    ) -> tuple[int, ...]:
        """Numbers of the constants that the results depend on."""
        g = Graph(self.given.real)
        inputs = self.given.inputs(g)
        seen: set[int] = set()
        for piece, graph in zip(pieces, made, strict=True):
            results = lower(g, graph, [*_own(g, piece), *inputs])
            seen |= {node.number for node in reachable(results)}
        first = self.given.clock
        count = len(self.given.constants)
        return tuple(i for i in range(count) if inputs[first + i].number in seen)

    def _inputs(self) -> list[Node]:
        """A node for each argument; a constant that is not read is 0."""
        layout, g, given = self.layout, self.graph, self.given
        nodes = layout.inputs(g)
        first, count = layout.clock, len(layout.constants)
        read = dict(zip(self.used, nodes[first : first + count], strict=True))
        constants = [
            read.get(i) or g.full(0, leaf.shape, leaf.kind)
            for i, leaf in enumerate(given.constants)
        ]
        return [*nodes[:first], *constants, *nodes[first + count :]]

    def _outputs(self, piece: Piece, made: GraphModule) -> list[Output]:
        nodes = lower(self.graph, made, [*_own(self.graph, piece), *self._inputs()])
        outputs = []
        for node, (place, offset, leaf) in zip(nodes, piece.results, strict=True):
            if (node.shape, node.kind) != (leaf.shape, leaf.kind):
                raise UntraceableError(
                    f"a carried value turns from {leaf.kind}{leaf.shape} "
                    f"into {node.kind}{node.shape} in a step"
                )
            if node.size:
                outputs.append(Output(node, place, offset))
        return outputs

    def wanted_places(self, constants: Sequence[int], segments: Sequence[int]) -> list[int]:
        """Places among the step's arguments of what has gradients, the carry's last."""
        given = self.given
        first = given.clock + len(given.constants)
        return [
            *(given.clock + self.used[i] for i in constants),
            *(first + i for i in segments),
            *(given.first_carry + i for i in given.floating),
        ]

    def gradient(self, piece: Piece, back: Back) -> list[Output]:
        """A piece's vector-Jacobian product: from `adj` to g_constant, g_segment, adj_out."""
        layout, g, count = self.layout, self.graph, len(piece.own)
        floating = [i for i, result in enumerate(piece.results) if result.leaf.kind == "f"]
        wanted = [i + count for i in self.wanted_places(back.constants, back.segments)]
        wanted += [number for number, _ in back.own]
        made = trace_vjp(self._flat(piece), [*_examples(piece), *self.examples], wanted, floating)
        inputs = [*_own(g, piece), *self._inputs()]
        for i in floating:
            _, offset, leaf = piece.results[i]
            inputs.append(g.input("adj", offset, leaf.shape, "f"))
        found = lower(g, made, inputs)
        places = self._gradient_places(back.constants)
        places += [("g_segment", o) for o in offsets([layout.segments[i] for i in back.segments])]
        places += [("adj_out", layout.carry_places[i][1]) for i in layout.floating]
        places += [(place, piece.own[number].offset) for number, place in back.own]
        outputs = []
        for node, (place, offset) in zip(found, places, strict=True):
            parts = _parts(g, node) if place == SUMS else [(node, 0)]
            outputs += [Output(part, place, offset + start) for part, start in parts if part.size]
        return outputs

    def _gradient_places(self, chosen: Sequence[int]) -> list[tuple[str, int]]:
        """Where the gradients of constants go: g_constant or g_shared, and the offset."""
        places, ends = [], {"constant": 0, "shared": 0}
        for leaf in (self.layout.constants[i] for i in chosen):
            places.append((f"g_{leaf.place}", ends[leaf.place]))
            ends[leaf.place] += math.prod(leaf.shape)
        return places

    def sizes(self, back: Back) -> tuple[int, int, int]:
        """How many numbers of constants, of segments and of shared constants have gradients."""
        ends = {"constant": 0, "shared": 0}
        for leaf in (self.layout.constants[i] for i in back.constants):
            ends[leaf.place] += math.prod(leaf.shape)
        segments = (self.layout.segments[i] for i in back.segments)
        return ends["constant"], sum(map(math.prod, segments)), ends["shared"]

    def constant_columns(self, chosen: Sequence[int], place: str = "constant") -> Tensor:
        """Columns of the array of constants, or of shared ones, that the chosen ones take."""
        layout = self.layout
        return _columns(
            (layout.constant_places[i][1], layout.constants[i].shape)
            for i in chosen
            if layout.constants[i].place == place
        )

    def segment_columns(self, chosen: Sequence[int]) -> Tensor:
        """Columns of the array of segments that the chosen ones take."""
        starts = offsets(self.layout.segments)
        return _columns((starts[i], self.layout.segments[i]) for i in chosen)


def carried(layout: Layout, chosen: Sequence[int] | None = None) -> tuple[Result, ...]:
    """The carry, or leaves of it, as results."""
    numbers = range(len(layout.carry)) if chosen is None else chosen
    return tuple(
        Result(f"{layout.carry_places[i][0]}_out", layout.carry_places[i][1], layout.carry[i])
        for i in numbers
    )


def _parts(g: Graph, x: Node) -> list[tuple[Node, int]]:
    """The rows that a gradient is made of, and where each begins; none that are zero."""
    if not x.shape:
        return [(x, 0)]
    edges = [0, *sorted(cuts(g, x).get(0, ())), x.shape[0]]
    row = math.prod(x.shape[1:])
    parts = [(narrow(g, x, 0, a, b - a), a * row) for a, b in pairwise(edges)]
    return [(part, start) for part, start in parts if number_of(part) != 0]


def _operations(made: GraphModule) -> list[str]:
    """`mul` of aten.mul.Tensor, for each operation of a trace."""
    targets = [str(node.target) for node in made.graph.nodes if node.op == "call_function"]
    names = [target.removeprefix("aten.").split(".")[0] for target in targets]
    return [name for name in names if "getitem" not in name]


def _examples(piece: Piece) -> list[Tensor]:
    return [own.example for own in piece.own]


def _own(g: Graph, piece: Piece) -> list[Node]:
    kinds = {g.real.dtype: "f", torch.bool: "b"}
    return [
        g.input(own.place, own.offset, own.example.shape, kinds.get(own.example.dtype, "i"))
        for own in piece.own
    ]


def _columns(places: Any) -> Tensor:
    ranges = [torch.arange(start, start + math.prod(shape)) for start, shape in places]
    return torch.cat(ranges) if ranges else torch.zeros(0, dtype=torch.int64)
