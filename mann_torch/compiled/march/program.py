"""A step as the compiler knows it: traced, lowered, and turned into kernels as they are needed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from ..cpp.outer import KEPT, with_factors
from ..cpp.plan import Output
from ..real import real_of
from ..trace.tracing import told
from .kernel_text import Function, KernelText, Sizes, backward_text, forward_text, is_turned
from .layout import Arguments, Layout
from .scope import Back, Piece, Scope, carried

#: What a step is to the compiler; it returns the next carry.
Step = Callable[[Arguments], Sequence[Tensor]]


class Program:
    """One step, ready to be marched.

    `given` is the layout of all that the step takes, `examples` are one sample's arguments: their
    dtype, float64 or float32, is what it computes in. Raises `UntraceableError`.
    """

    def __init__(self, step: Step, given: Layout, examples: Sequence[Tensor]) -> None:
        self._step = step
        with torch.inference_mode(False):
            # Views would be traced as raw `as_strided`.
            self.examples = [x.detach().clone() for x in examples]
        given = dataclasses.replace(given, real=real_of(self.examples))
        self.given = given
        #: Leaves of the carry that the compiled step alone writes.
        self.private: frozenset[int] = frozenset()
        #: What has been compared with eager torch, and what was found: see `agreement`.
        self.verdicts: dict[Any, str | None] = {}
        self._texts: dict[Any, KernelText] = {}
        self._gradients: dict[Back, list[list[Output]]] = {}
        self._pieces = self.pieces()
        self.scope = told(lambda: Scope(given, self.examples, self._pieces))
        #: As `given`, without the constants that are not read; `used` are the numbers of the rest.
        self.layout, self.used = self.scope.layout, self.scope.used

    def pieces(self) -> list[Piece]:
        """What is traced."""
        return [Piece(lambda _, given: self._step(given), carried(self.given))]

    def flat_step(self, flat: Sequence[Tensor]) -> Sequence[Tensor]:
        """The step as a function of one list, in eager torch."""
        return self._step(self.scope.arguments(flat))

    def forward(self, lanes: int) -> KernelText:
        """Text of the forward kernel."""
        if lanes not in self._texts:
            self._texts[lanes] = self._forward(lanes)
        return self._texts[lanes]

    def _forward(self, lanes: int) -> KernelText:
        return forward_text(self.layout, [self._function()], lanes)

    def _function(self) -> Function:
        return Function("Step", self.scope.outputs[0])

    def backward(self, lanes: int, constants: Sequence[int], segments: Sequence[int]) -> KernelText:
        """Text of the backward kernel, with gradients to the numbered constants and segments."""
        back = Back(tuple(constants), tuple(segments))
        if (lanes, back) not in self._texts:
            self._texts[lanes, back] = self._backward(lanes, back)
        return self._texts[lanes, back]

    def _backward(self, lanes: int, back: Back) -> KernelText:
        (outputs,) = self.gradients(back)
        sizes = Sizes(*self.scope.sizes(back), wide_segment=self.width(back))
        gives: tuple[str, ...] = ()
        if self.layout.size("shared"):
            outputs, outers = with_factors(self.scope.graph, outputs)
            sizes, gives = sizes._replace(outers=outers), (KEPT,)
        functions = [self._function(), Function("Back", outputs, gives=gives, backward=True)]
        return backward_text(self.layout, functions, sizes, lanes)

    def width(self, back: Back) -> int:
        """Numbers of a row of the segments' gradients: a segment's own where those come first."""
        columns = self.scope.segment_columns(back.segments)
        first = torch.equal(columns, torch.arange(len(columns)))
        rows = first and len(columns) > 0 and is_turned(self.layout)
        return self.layout.size("segment") if rows else len(columns)

    def gradients(self, back: Back) -> list[list[Output]]:
        """Outputs of each piece's vector-Jacobian product."""
        if back not in self._gradients:
            self._gradients[back] = told(lambda: self._lowered(back))
        return self._gradients[back]

    def _lowered(self, back: Back) -> list[list[Output]]:
        return [self.scope.gradient(piece, back) for piece in self._pieces]
