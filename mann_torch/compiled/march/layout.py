"""What a step takes and gives: the arrays of its values, and where each tensor lies in them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from ..graph.nodes import Graph, Node, Shape
from ..real import DOUBLE, Real


class Arguments(NamedTuple):
    """What a step takes: tensors of one sample, in lists."""

    clock: list[Tensor]
    constants: list[Tensor]
    segments: list[Tensor]
    noise: list[Tensor]
    carry: list[Tensor]


class Leaf(NamedTuple):
    """A tensor of one sample: shape, and kind of element (f, i or b).

    A floating constant that is `shared` is one tensor for all samples.
    """

    shape: Shape
    kind: str = "f"
    shared: bool = False

    @classmethod
    def of(cls, x: Tensor, shared: bool = False) -> Leaf:
        """That of a tensor as one sample has it."""
        kind = "f" if x.is_floating_point() else "b" if x.dtype == torch.bool else "i"
        return cls(tuple(x.shape), kind, shared)

    @property
    def place(self) -> str:
        """The array of constants it lies in."""
        if self.kind != "f":
            return "whole"
        return "shared" if self.shared else "constant"


class Moved(NamedTuple):
    """The arrays of a march that gradients reach: see `autograd.march`."""

    constants: Tensor
    segments: Tensor
    carry: Tensor
    shared: Tensor


@dataclass(frozen=True)
class Layout:
    """The tensors of a step, in the order of its `Arguments`.

    A step is a function of them and returns the next carry. Floating leaves of the carry have
    gradients, others ride along. The first `n_motion` floating numbers of the carry are what is
    kept as motion; the leaves `watched` are compared with the limit.
    """

    clock: int  # numbers () that all samples share and each step has of its own: time, size
    constants: tuple[Leaf, ...]  # a sample's own, unless it is shared
    segments: tuple[Shape, ...]  # a sample's own, piecewise constant in time
    noise: tuple[Shape, ...]  # unit normal numbers of each step
    carry: tuple[Leaf, ...]
    n_motion: int
    watched: tuple[int, ...]  # indices in `carry`
    real: Real = DOUBLE

    def with_carry(self, leaves: Sequence[Leaf]) -> Layout:
        """The same with more to carry."""
        return replace(self, carry=(*self.carry, *leaves))

    @cached_property
    def floating(self) -> tuple[int, ...]:
        """Indices of the floating leaves of the carry."""
        return tuple(i for i, leaf in enumerate(self.carry) if leaf.kind == "f")

    @cached_property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the others."""
        return tuple(i for i, leaf in enumerate(self.carry) if leaf.kind != "f")

    @cached_property
    def carry_places(self) -> tuple[tuple[str, int], ...]:
        """Array (f or k) and offset of each leaf of the carry."""
        places, ends = [], {"f": 0, "k": 0}
        for leaf in self.carry:
            array = "f" if leaf.kind == "f" else "k"
            places.append((array, ends[array]))
            ends[array] += math.prod(leaf.shape)
        return tuple(places)

    def carried(self, f: Tensor, k: Tensor, shape: tuple[int, ...]) -> list[Tensor]:
        """Leaves (*shape, *event) of the carry from its two arrays (..., F) and (..., K)."""
        found = []
        for leaf, (array, offset) in zip(self.carry, self.carry_places, strict=True):
            source = f if array == "f" else k
            end = offset + math.prod(leaf.shape)
            value = source[..., offset:end].reshape((*shape, *leaf.shape))
            found.append(value != 0 if leaf.kind == "b" else value)
        return found

    def size(self, name: str) -> int:
        """Numbers a sample has in an array: constant, shared, whole, segment, noise, f or k."""
        if name in "fk":
            chosen = self.floating if name == "f" else self.discrete
            return sum(math.prod(self.carry[i].shape) for i in chosen)
        return sum(map(math.prod, self._shapes(name)))

    def _shapes(self, name: str) -> list[Shape]:
        if name in ("constant", "shared", "whole"):
            return [c.shape for c in self.constants if c.place == name]
        return list({"segment": self.segments, "noise": self.noise}[name])

    @cached_property
    def constant_places(self) -> tuple[tuple[str, int], ...]:
        """Array (constant, shared, or whole for integers and masks) and offset of each constant."""
        places, ends = [], {"constant": 0, "shared": 0, "whole": 0}
        for leaf in self.constants:
            places.append((leaf.place, ends[leaf.place]))
            ends[leaf.place] += math.prod(leaf.shape)
        return tuple(places)

    def inputs(self, g: Graph) -> list[Node]:
        """A node for each argument of the step, in order."""
        nodes = [g.input("clock", i, (), "f") for i in range(self.clock)]
        for leaf, (array, offset) in zip(self.constants, self.constant_places, strict=True):
            nodes.append(g.input(array, offset, leaf.shape, leaf.kind))
        for name, shapes in (("segment", self.segments), ("noise", self.noise)):
            for offset, shape in zip(offsets(shapes), shapes, strict=True):
                nodes.append(g.input(name, offset, shape, "f"))
        for leaf, (array, offset) in zip(self.carry, self.carry_places, strict=True):
            nodes.append(g.input(array, offset, leaf.shape, leaf.kind))
        return nodes

    @property
    def first_carry(self) -> int:
        """Place of the first leaf of the carry among the step's arguments."""
        return self.clock + len(self.constants) + len(self.segments) + len(self.noise)


def offsets(shapes: Sequence[Shape]) -> list[int]:
    """Where each tensor begins when they lie one after the other."""
    return [0, *itertools.accumulate(map(math.prod, shapes))][: len(shapes)]
