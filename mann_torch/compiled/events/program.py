"""A step that stops at its first event, as the compiler knows it: pieces and a skeleton."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from ..cpp.plan import Output
from ..march.kernel_text import Function, KernelText, Sizes, Skeleton, backward_text, forward_text
from ..march.layout import Arguments, Layout, Leaf
from ..march.program import Program
from ..march.scope import Back, Own, Piece, Result, carried
from ..real import DOUBLE
from ..trace.telling import UntraceableError
from .back_text import BACK, room_backward
from .rules_text import COUNTS, NOTES, RULES, numbers
from .step_text import STEP, room

#: Leaves that the carry of a hybrid step ends with: what is counted, and notes for the gradient.
EVENT_LEAVES = (Leaf((len(COUNTS),), "i"), Leaf((len(NOTES),), "i"))


class Places(NamedTuple):
    """Numbers of the leaves of the carry () int64 that the skeleton itself reads and writes."""

    attended: int  # the branch in force; -1 before the first step
    switches: int  # how often it has changed


class HybridStep(Protocol):
    """A hybrid step of one sample: what `simulation/events/steps.Branched` is to the torch engine.

    t, h () [s]; `given` are the step's arguments, its carry that of one sample.
    """

    places: Places
    n_branches: int

    def held(self, t: Tensor, h: Tensor, weights: Tensor, given: Arguments) -> Sequence[Tensor]:
        """Floating leaves of the carry after a flow from t to t + h, branches weighted (S,)."""

    def near(self, t: Tensor, given: Arguments) -> Sequence[Tensor]:
        """Distances (S,) of the branches, and the reset's margin ()."""

    def reset(self, t: Tensor, given: Arguments) -> Sequence[Tensor]:
        """The carry after a reset at t."""

    def totals(self, given: Arguments, after: Sequence[Tensor]) -> Sequence[Tensor]:
        """Floating leaves of the carry at the step's end, what is summed up brought forward.

        `given` has the carry at the start, after the jump; `after` are the floating leaves as the
        flow left them.
        """

    def __call__(self, given: Arguments) -> Sequence[Tensor]:
        """The whole step in eager torch, with which the compiled one is compared."""


class EventProgram(Program):
    """A hybrid step, ready to be marched; the carry ends with `EVENT_LEAVES`.

    clock: t, h, and what else `totals` reads. Raises `UntraceableError`.
    """

    _step: HybridStep

    def __init__(self, step: HybridStep, given: Layout, examples: Sequence[Tensor]) -> None:
        super().__init__(step, given, examples)
        if self.given.real is not DOUBLE or any(leaf.shared for leaf in given.constants):
            raise UntraceableError("a hybrid step computes in float64, without shared constants")
        self.private = frozenset({len(given.carry) - 1})

    def pieces(self) -> list[Piece]:
        """held, near, reset, totals."""
        step, given = self._step, self.given
        count = step.n_branches
        instant = torch.tensor(0.1, dtype=torch.float64)
        t, h = Own("moment", 0, instant), Own("moment", 1, instant)
        weights = Own("weights", 0, torch.full((count,), 1.0 / count, dtype=torch.float64))
        moving = carried(given, given.floating)
        first = given.first_carry
        after = tuple(
            Own("after", given.carry_places[i][1], self.examples[first + i]) for i in given.floating
        )
        near = (Result("near_out", 0, Leaf((count,))), Result("near_out", count, Leaf(())))
        return [
            Piece(lambda own, a: step.held(own[0], own[1], own[2], a), moving, (t, h, weights)),
            Piece(lambda own, a: step.near(own[0], a), near, (t,)),
            Piece(lambda own, a: step.reset(own[0], a), carried(given), (t,)),
            Piece(lambda own, a: step.totals(a, own), moving, after),
        ]

    def _forward(self, lanes: int) -> KernelText:
        return forward_text(self.layout, self._functions(), lanes, self._skeleton(0, 0))

    def _functions(self) -> list[Function]:
        held, near, reset, totals = self.scope.outputs
        moment = ("moment", "f")
        return [
            Function("Held", held, (moment, ("weights", "f"))),
            Function("Near", near, (moment,), ("near_out",)),
            Function("Reset", reset, (moment,)),
            Function("Totals", totals, (("after", "f"),)),
        ]

    def _backward(self, lanes: int, back: Back) -> KernelText:
        sizes = Sizes(*self.scope.sizes(back))
        held, near, reset, totals = self.gradients(back)
        moment = ("moment", "f")
        functions = [
            *self._functions(),
            Function("BackHeld", held, (moment, ("weights", "f")), ("g_moment", "g_weights"), True),
            Function("BackNear", near, (moment,), ("g_moment",), True),
            Function("BackReset", reset, (moment,), ("g_moment",), True),
            Function("BackTotals", totals, (("after", "f"),), ("g_after",), True),
        ]
        return backward_text(
            self.layout, functions, sizes, lanes, self._skeleton(sizes.wanted, sizes.wanted_segment)
        )

    def _lowered(self, back: Back) -> list[list[Output]]:
        after = range(len(self.layout.floating))
        own = (
            ((0, "g_moment"), (1, "g_moment"), (2, "g_weights")),
            ((0, "g_moment"),),
            ((0, "g_moment"),),
            tuple((i, "g_after") for i in after),
        )
        return [
            self.scope.gradient(piece, back._replace(own=more))
            for piece, more in zip(self._pieces, own, strict=True)
        ]

    def _skeleton(self, wanted: int, wanted_segment: int) -> Skeleton:
        layout, places, count = self.layout, self._step.places, self._step.n_branches
        f, k, last = layout.size("f"), layout.size("k"), len(layout.carry)
        at = [layout.carry_places[i][1] for i in (*places, last - 2, last - 1)]
        return Skeleton(
            numbers=numbers(count, *at),
            forward=RULES + STEP,
            backward=BACK,
            room=room(f, k, count),
            room_backward=room_backward(f, k, count, wanted, wanted_segment),
        )
