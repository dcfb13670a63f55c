"""Derivatives of activations that torch has no decomposition for, or rounds in its own way."""

from __future__ import annotations

import torch

from ..graph.arithmetic import pointwise
from ..graph.nodes import Graph, Node
from .registry import lowers


def between(g: Graph, x: Node, low: float, high: float, op: str) -> Node:
    """Where x lies between two numbers; `op`, lt or le, says whether their own count."""
    above = pointwise(g, op, [g.full(low, (), "f"), x], "b")
    below = pointwise(g, op, [x, g.full(high, (), "f")], "b")
    return pointwise(g, "and", [above, below], "b")


@lowers("softshrink_backward.default", "hardshrink_backward.default")
def _shrink_back(g: Graph, kind: str, gradient: Node, x: Node, width: float) -> Node:
    small = between(g, x, -width, width, "le")
    return pointwise(g, "where", [small, g.full(0.0, (), "f"), gradient], "f")


@lowers("hardsigmoid_backward.default")
def _hardsigmoid_back(g: Graph, kind: str, gradient: Node, x: Node) -> Node:
    # Torch's sixth is one of float32.
    sixth = g.full(float(torch.tensor(1 / 6, dtype=torch.float32)), (), "f")
    parts = [
        between(g, x, -3.0, 3.0, "lt"),
        pointwise(g, "mul", [gradient, sixth], "f"),
        g.full(0.0, (), "f"),
    ]
    return pointwise(g, "where", parts, "f")
