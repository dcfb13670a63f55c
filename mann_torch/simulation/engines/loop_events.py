"""A closed loop's hybrid step as the compiler takes it: its pieces, of one sample's tensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...compiled import EVENT_LEAVES, Arguments, EventProgram, Layout, Places
from ...trees import leaf_names, leaves, rebuilt
from ...types import LoopState, MemoryMode, Proximity
from ..events.branches import Branches
from ..events.steps import EventCounts, hybrid_step, jump
from ..task import Task
from .loop_step import Bound, LoopStep


class Scene(NamedTuple):
    """A step's arguments as the loop knows them."""

    system: Branches
    y: Tensor
    mode: MemoryMode
    sums: list[Tensor]
    here: Bound


class LoopEvents(LoopStep):
    """The hybrid step of a task; the carry ends with `EVENT_LEAVES`."""

    program = EventProgram

    def __init__(self, task: Task, *arguments: Any) -> None:
        super().__init__(task, *arguments)
        names = leaf_names(task.mode.controller)
        first = len(leaves(self._state)) + self.n_sums
        self.places = Places(*(first + names.index(n) for n in ("attended", "switches")))
        self.n_branches = task.mode.controller.active.shape[-1]

    def layout(self, constants: Sequence[Tensor], segments: Sequence[Tensor]) -> Layout:
        """Of constants and coefficients as one sample has them."""
        return super().layout(constants, segments).with_carry(EVENT_LEAVES)

    def extra(self, count: int) -> list[Tensor]:
        """Counts and notes, 0."""
        return [torch.zeros(count, *leaf.shape, dtype=torch.int64) for leaf in EVENT_LEAVES]

    def split(self, carry: Sequence[Tensor]) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
        """State leaves, sums, and mode leaves."""
        return super().split(carry[: -len(EVENT_LEAVES)])

    @contextmanager
    def _scene(self, given: Arguments) -> Iterator[Scene]:
        with self._bound(given) as here:
            state, sums, mode = self.split(given.carry)
            system = Branches(self._loop, self._solver, self._packer, here.conditions, None)
            y = self._packer.pack(rebuilt(self._state, state))
            yield Scene(system, y, rebuilt(self._mode.controller, mode), sums, here)

    def _moved(self, y: Tensor, given: Arguments) -> list[Tensor]:
        """Floating leaves of the carry, the state's new."""
        _, sums, mode = self.split(given.carry)
        state: LoopState = self._packer.unpack(y)
        return _floating(
            [*self.join(leaves(state), sums, mode), *given.carry[-len(EVENT_LEAVES) :]]
        )

    def held(self, t: Tensor, h: Tensor, weights: Tensor, given: Arguments) -> list[Tensor]:
        """See `compiled.HybridStep`."""
        with self._scene(given) as s:
            return self._moved(s.system.flow(t, h, s.y, weights, s.mode), given)

    def near(self, t: Tensor, given: Arguments) -> Proximity:
        """See `compiled.HybridStep`."""
        with self._scene(given) as s:
            return s.system.proximity(t, s.y, s.mode)

    def reset(self, t: Tensor, given: Arguments) -> list[Tensor]:
        """See `compiled.HybridStep`."""
        if not self._loop.controller.reallocates:
            return list(given.carry)
        with self._scene(given) as s:
            due = t.new_ones((), dtype=torch.bool)
            y, mode = s.system.reset(t, s.y, s.mode, due)
            state = leaves(self._packer.unpack(y))
        return [*self.join(state, s.sums, leaves(mode)), *given.carry[-len(EVENT_LEAVES) :]]

    def totals(self, given: Arguments, after: Sequence[Tensor]) -> list[Tensor]:
        """See `compiled.HybridStep`."""
        with self._scene(given) as s:
            u = s.system.command(given.clock[0], s.y, s.mode) if self._effort else None
            sums = self._summed(given.clock, s.sums, self._after(after), u, s.here)
        first = self.n_plant
        return [*after[:first], *sums, *after[first + self.n_sums :]]

    def _after(self, moved: Sequence[Tensor]) -> LoopState:
        """The state in a carry's floating leaves."""
        return rebuilt(self._state, super().split(moved)[0])

    def __call__(self, given: Arguments) -> list[Tensor]:
        """The next carry, as the torch engine computes it; notes stay."""
        t, h = given.clock[:2]
        with self._scene(given) as s:
            commanded = None
            if self._effort:
                commanded = s.system.command(t, *jump(s.system, t, s.y, s.mode))
            y, mode, met = hybrid_step(s.system, t, h, s.y, s.mode)
            state: LoopState = self._packer.unpack(y)
            sums = self._summed(given.clock, s.sums, state, commanded, s.here)
        *_, counted, noted = given.carry
        counts = counted + torch.stack(met)
        return [*self.join(leaves(state), sums, leaves(mode)), counts, noted]


def counts_of(leaf: Tensor) -> EventCounts:
    """(..., 3) -> each (...,)."""
    return EventCounts(*leaf.unbind(-1))


def _floating(carry: Sequence[Tensor]) -> list[Tensor]:
    return [leaf for leaf in carry if leaf.is_floating_point()]
