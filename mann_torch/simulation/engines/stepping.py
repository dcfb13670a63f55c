"""One step of a whole batch: jump, flow, and hold on to samples that diverge."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...functional import pick
from ...trees import Packer, leaves, map_tensors
from ...types import LoopMode, LoopState
from ..closed_loop import ClosedLoop
from ..conditions import Conditions
from ..events.branches import Branches
from ..events.steps import EventCounts, hybrid_step
from ..events.steps import jump as jump_at_events
from ..jumping import jump
from ..solvers.compiling import CompiledOrEager
from ..solvers.flat_flow import FlatFlow, flat_rates
from ..solvers.solver import Solver


class Carry(NamedTuple):
    """What passes from step to step."""

    y: Tensor  # (..., M)
    mode: LoopMode
    alive: Tensor  # (...,) bool
    input: Tensor | None = None  # (..., m) commanded at the step's start, for effort
    events: EventCounts | None = None  # so far; None in plain steps


def advance(
    loop: ClosedLoop,
    solver: Solver,
    packer: Packer[LoopState],
    rates: Callable[..., Any],
    effort: bool,
    t: Tensor,
    h: Tensor,
    y: Tensor,
    mode: LoopMode,
    here: Conditions,
    moving: Tensor | None = None,
) -> tuple[Tensor, LoopMode, Tensor | None]:
    """Jump and flow: the step that every engine takes.

    State (..., M) and mode after it, and with `effort` the input (..., m) commanded at its start.
    `rates` are `flat_rates` of the loop.
    """
    if leaves(mode):
        state, mode = jump(loop, t, packer.unpack(y), mode, here)
        if loop.jumps_state:
            y = packer.pack(state)
    commanded = None
    if effort:
        commanded = loop.commanded(t, packer.unpack(y), mode, here)
    return solver.step(FlatFlow(rates, mode, here, moving), t, h, y), mode, commanded


class Stepper:
    """One jump and one solver step of the whole batch, compiled if asked for."""

    def __init__(
        self,
        loop: ClosedLoop,
        solver: Solver,
        packer: Packer[LoopState],
        limit: float,
        effort: bool = False,
        hybrid: bool = False,
    ) -> None:
        self._loop, self._solver, self.packer, self._limit = loop, solver, packer, limit
        self._effort = effort
        self._rates: Callable[..., Any] = partial(flat_rates, loop, packer)
        self._call: Callable[..., Carry] = self._advance
        self._compiled: CompiledOrEager | None = None
        if hybrid:  # what happens in a step depends on its data: it is not compiled
            self._call = self._advance_through_events
        elif solver.compile:
            if solver.fuses_step:
                self._call = self._compiled = CompiledOrEager(self._advance)
            else:
                self._rates = self._compiled = CompiledOrEager(self._rates)

    @property
    def engine(self) -> str:
        return "eager" if self._compiled is None else self._compiled.engine

    def __call__(
        self, t: Tensor, h: Tensor, carry: Carry, here: Conditions, moving: Tensor | None = None
    ) -> Carry:
        return self._call(t, h, carry, here, moving)

    def _advance(
        self, t: Tensor, h: Tensor, carry: Carry, here: Conditions, moving: Tensor | None
    ) -> Carry:
        y, mode, commanded = advance(
            self._loop, self._solver, self.packer, self._rates, self._effort,
            t, h, carry.y, carry.mode, here, moving,
        )  # fmt: skip
        # NaN compares as False, so that this catches it too.
        return Carry(y, mode, y.abs().amax(dim=-1) < self._limit, commanded)

    def _advance_through_events(
        self, t: Tensor, h: Tensor, carry: Carry, here: Conditions, moving: Tensor | None
    ) -> Carry:
        aligned = here._replace(signals=here.signals.aligned)  # type: ignore[attr-defined]
        system = Branches(self._loop, self._solver, self.packer, aligned, moving)
        commanded, inner = None, carry.mode.controller
        if self._effort:
            commanded = system.command(t, *jump_at_events(system, t, carry.y, inner))
        y, inner, met = hybrid_step(system, t, h, carry.y, inner)
        events = map_tensors(torch.add, carry.events, met)
        alive = y.abs().amax(dim=-1) < self._limit
        return Carry(y, LoopMode(inner), alive, commanded, events)

    def without_dead(
        self, t: Tensor, h: Tensor, carry: Carry, safe: Tensor, here: Conditions
    ) -> tuple[Carry, Tensor]:
        """The step again with the samples that are or fall dead held at their last state.

        Also returns what those that fell came to, (..., M).

        They compute from `safe` (..., M), and stand still there, so that their numbers stay finite
        and no NaN of theirs reaches a shared gradient (`where` alone would pass it: 0 times NaN
        is NaN) or a shared step size.
        """
        alive, fallen = carry.alive, safe
        while True:
            y = torch.where(alive.unsqueeze(-1), carry.y, safe)
            after = self(t, h, carry._replace(y=y), here, alive)
            still = alive & after.alive
            fallen = torch.where((alive & ~still).unsqueeze(-1), after.y.detach(), fallen)
            if bool((still == alive).all()):
                break
            alive = still
        y = torch.where(alive.unsqueeze(-1), after.y, carry.y)
        mode = map_tensors(lambda new, old: pick(alive, new, old), after.mode, carry.mode)
        events = map_tensors(lambda new, old: pick(alive, new, old), after.events, carry.events)
        return Carry(y, mode, alive, after.input, events), fallen
