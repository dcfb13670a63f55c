"""A step as the compiler knows it: traced, lowered, and turned into kernels as they are needed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.fx import GraphModule

from ..cpp.plan import Output
from ..graph.nodes import Graph, Node, reachable
from ..lowering import lower
from ..trace.telling import UntraceableError
from ..trace.tracing import told, trace, trace_vjp
from .kernel_text import KernelText, Sizes, backward_text, forward_text
from .layout import Layout, offsets

#: (clock, constants, segments, noise, carry) -> carry, each a list of tensors of one sample.
Step = Callable[..., Sequence[Tensor]]


class Arguments(NamedTuple):
    """A step's arguments, each a list."""

    clock: list[Tensor]
    constants: list[Tensor]
    segments: list[Tensor]
    noise: list[Tensor]
    carry: list[Tensor]


class Program:
    """One step, ready to be marched.

    `given` is the layout of all that the step takes; constants it does not read are left out of
    `layout`, and `used` are the numbers of those that stay. `examples` are one sample's arguments.
    Raises `UntraceableError`.
    """

    def __init__(self, step: Step, given: Layout, examples: Sequence[Tensor]) -> None:
        self._step, self.given = step, given
        with torch.inference_mode(False):
            # Views would be traced as raw `as_strided`.
            self.examples = [x.detach().clone() for x in examples]
        #: What has been compared with eager torch, and what was found: see `agreement`.
        self.verdicts: dict[Any, str | None] = {}
        self._texts: dict[Any, KernelText] = {}
        self._gradients: dict[Any, tuple[list[Output], Sizes]] = {}
        self._outputs = told(self._traced)

    def _traced(self) -> list[Output]:
        made = trace(self.flat_step, self.examples)
        self.operations = len(made.graph.nodes)
        self.used = self._constants_in(made)
        kept = tuple(self.given.constants[i] for i in self.used)
        self.layout = dataclasses.replace(self.given, constants=kept)
        self._graph = Graph()
        found = self._results(lower(self._graph, made, self._inputs()))
        return found

    def _constants_in(self, made: GraphModule) -> tuple[int, ...]:
        """Numbers of the constants that the step's results depend on."""
        g = Graph()
        inputs = self.given.inputs(g)
        results = lower(g, made, inputs)
        seen = {node.number for node in reachable(results)}
        first = self.given.clock
        count = len(self.given.constants)
        return tuple(i for i in range(count) if inputs[first + i].number in seen)

    def _inputs(self) -> list[Node]:
        """A node for each argument; a constant that is not read is 0."""
        layout, g, given = self.layout, self._graph, self.given
        nodes = layout.inputs(g)
        first, count = layout.clock, len(layout.constants)
        read = dict(zip(self.used, nodes[first : first + count], strict=True))
        constants = [
            read.get(i) or g.full(0, leaf.shape, leaf.kind)
            for i, leaf in enumerate(given.constants)
        ]
        return [*nodes[:first], *constants, *nodes[first + count :]]

    def _results(self, nodes: Sequence[Node]) -> list[Output]:
        outputs = []
        for node, leaf, (array, offset) in zip(
            nodes, self.layout.carry, self.layout.carry_places, strict=True
        ):
            if (node.shape, node.kind) != (leaf.shape, leaf.kind):
                raise UntraceableError(
                    f"a carried value turns from {leaf.kind}{leaf.shape} "
                    f"into {node.kind}{node.shape} in a step"
                )
            if node.size:
                outputs.append(Output(node, f"{array}_out", offset))
        return outputs

    def arguments(self, flat: Sequence[Tensor]) -> Arguments:
        """The step's arguments from one flat list."""
        given, parts, start = self.given, [], 0
        counts = (given.clock, len(given.constants), len(given.segments), len(given.noise))
        for count in (*counts, len(given.carry)):
            parts.append(list(flat[start : start + count]))
            start += count
        return Arguments(*parts)

    def flat_step(self, flat: Sequence[Tensor]) -> Sequence[Tensor]:
        """The step as a function of one list."""
        return self._step(*self.arguments(flat))

    def forward(self, lanes: int) -> KernelText:
        """Text of the forward kernel."""
        if lanes not in self._texts:
            self._texts[lanes] = forward_text(self.layout, self._outputs, lanes)
        return self._texts[lanes]

    def backward(self, lanes: int, constants: Sequence[int], segments: Sequence[int]) -> KernelText:
        """Text of the backward kernel, with gradients to the numbered constants and segments."""
        key = (lanes, tuple(constants), tuple(segments))
        if key not in self._texts:
            outputs, sizes = self._vjp(key[1], key[2])
            self._texts[key] = backward_text(self.layout, self._outputs, outputs, sizes, lanes)
        return self._texts[key]

    def wanted_places(self, constants: Sequence[int], segments: Sequence[int]) -> list[int]:
        """Places among the step's arguments of what has gradients, the carry's last.

        Constants are numbered among those that are used.
        """
        given = self.given
        first = given.clock + len(given.constants)
        return [
            *(given.clock + self.used[i] for i in constants),
            *(first + i for i in segments),
            *(given.first_carry + i for i in given.floating),
        ]

    def _vjp(
        self, constants: tuple[int, ...], segments: tuple[int, ...]
    ) -> tuple[list[Output], Sizes]:
        key = (constants, segments)
        if key not in self._gradients:
            self._gradients[key] = told(lambda: self._lowered_vjp(constants, segments))
        return self._gradients[key]

    def _lowered_vjp(
        self, constants: tuple[int, ...], segments: tuple[int, ...]
    ) -> tuple[list[Output], Sizes]:
        layout, g = self.layout, self._graph
        wanted = self.wanted_places(constants, segments)
        made = trace_vjp(self.flat_step, self.examples, wanted, layout.floating)
        inputs = self._inputs()
        for i in layout.floating:
            inputs.append(g.input("adj", layout.carry_places[i][1], layout.carry[i].shape, "f"))
        found = lower(g, made, inputs)
        shapes = [layout.constants[i].shape for i in constants]
        segment_shapes = [layout.segments[i] for i in segments]
        places = [("g_constant", o) for o in offsets(shapes)]
        places += [("g_segment", o) for o in offsets(segment_shapes)]
        places += [("adj_out", layout.carry_places[i][1]) for i in layout.floating]
        outputs = [
            Output(node, place, offset)
            for node, (place, offset) in zip(found, places, strict=True)
            if node.size
        ]
        return outputs, Sizes(sum(map(math.prod, shapes)), sum(map(math.prod, segment_shapes)))

    def constant_columns(self, chosen: Sequence[int]) -> Tensor:
        """Columns of the array of constants that the chosen ones take."""
        layout = self.layout
        return _columns((layout.constant_places[i][1], layout.constants[i].shape) for i in chosen)

    def segment_columns(self, chosen: Sequence[int]) -> Tensor:
        """Columns of the array of segments that the chosen ones take."""
        starts = offsets(self.layout.segments)
        return _columns((starts[i], self.layout.segments[i]) for i in chosen)


def _columns(places: Any) -> Tensor:
    ranges = [torch.arange(start, start + math.prod(shape)) for start, shape in places]
    return torch.cat(ranges) if ranges else torch.zeros(0, dtype=torch.int64)
