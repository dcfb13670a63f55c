"""Parts of a trace that no argument reaches: torch itself computes them, once."""

from __future__ import annotations

import operator
from typing import Any

import torch
from torch.fx import GraphModule
from torch.fx import Node as Traced
from torch.fx.node import map_arg

from ..trace.tracing import attribute_of


def random(traced: Traced) -> bool:
    """Whether an operation draws random numbers."""
    return torch.Tag.nondeterministic_seeded in getattr(traced.target, "tags", ())


class Constants:
    """Operations of numbers alone, and their values where they are asked for."""

    def __init__(self, made: GraphModule) -> None:
        self._made = made
        self._found: set[Traced] = set()
        self._values: dict[Traced, Any] = {}
        for traced in made.graph.nodes:
            held = traced.op == "get_attr"
            called = traced.op == "call_function" and not random(traced)
            if held or (called and self._found.issuperset(traced.all_input_nodes)):
                self._found.add(traced)

    def __contains__(self, traced: Traced) -> bool:
        return traced in self._found

    def of(self, traced: Traced) -> Any:
        """The tensor, or the tuple of them, that an operation gives."""
        if traced not in self._values:
            # The graph lists operands first: no recursion through a long chain.
            for node in self._needed(traced):
                self._values[node] = self._computed(node)
        return self._values[traced]

    def _needed(self, traced: Traced) -> list[Traced]:
        wanted = {traced}
        for node in reversed(self._made.graph.nodes):
            if node in wanted and node not in self._values:
                wanted.update(node.all_input_nodes)
        order = [node for node in self._made.graph.nodes if node in wanted]
        return [node for node in order if node not in self._values]

    def _computed(self, node: Traced) -> Any:
        if node.op == "get_attr":
            return attribute_of(self._made, str(node.target))
        args: Any = map_arg(node.args, self._values.__getitem__)
        keywords: Any = map_arg(node.kwargs, self._values.__getitem__)
        if node.target is operator.getitem:
            return args[0][args[1]]
        with torch.no_grad():
            return node.target(*args, **keywords)  # type: ignore[operator]
