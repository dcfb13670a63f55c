"""One step of a whole batch: jump, flow, and hold on to samples that diverge."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..functional import pick
from ..plants.plant import Coefficients
from ..signals import Reference
from ..trees import Packer, map_tensors
from ..types import Linearization, LoopState, Measurement, Mode
from .closed_loop import ClosedLoop
from .compiling import CompiledOrEager
from .solver import Solver


class Carry(NamedTuple):
    """What passes from step to step."""

    y: Tensor  # (..., M)
    mode: Mode
    alive: Tensor  # (...,) bool
    torque: Tensor | None = None  # (..., n) at the step's start, where effort is measured


class _FlatFlow:
    """The loop's vector field on flat states, with mode and coefficients frozen.

    Rows outside `moving` (...,), all if None, stand still.
    """

    def __init__(self, rates: Callable[..., Any], frozen: Any, moving: Tensor | None) -> None:
        self._rates, self._frozen, self._moving = rates, frozen, moving

    def __call__(self, t: Tensor, y: Tensor) -> Tensor:
        return self._hold(self._rates(t, y, *self._frozen, False)[0])

    def linearized(self, t: Tensor, y: Tensor) -> tuple[Tensor, Linearization]:
        rate, block = self._rates(t, y, *self._frozen, True)
        return self._hold(rate), map_tensors(self._hold, block)

    def _hold(self, value: Tensor) -> Tensor:
        if self._moving is None:
            return value
        return pick(self._moving, value, torch.zeros_like(value))


class Stepper:
    """One jump and one solver step of the whole batch, compiled if asked for."""

    def __init__(
        self,
        loop: ClosedLoop,
        solver: Solver,
        packer: Packer[LoopState],
        limit: float,
        effort: bool = False,
    ) -> None:
        self._loop, self._solver, self._packer, self._limit = loop, solver, packer, limit
        self._effort = effort
        self._rates: Callable[..., Any] = self._flat_rates
        self._call: Callable[..., Carry] = self._advance
        self._compiled: CompiledOrEager | None = None
        if solver.compile:
            if solver.fuses_step:
                self._call = self._compiled = CompiledOrEager(self._advance)
            else:
                self._rates = self._compiled = CompiledOrEager(self._flat_rates)

    @property
    def engine(self) -> str:
        return "eager" if self._compiled is None else self._compiled.engine

    def __call__(
        self,
        t: Tensor,
        h: Tensor,
        carry: Carry,
        reference: Reference,
        coefficients: Coefficients,
        noise: Measurement | None = None,
        moving: Tensor | None = None,
    ) -> Carry:
        return self._call(t, h, carry, reference, coefficients, noise, moving)

    def _flat_rates(
        self,
        t: Tensor,
        y: Tensor,
        mode: Mode,
        reference: Reference,
        coefficients: Coefficients,
        noise: Measurement | None,
        linearize: bool,
    ) -> tuple[Tensor, Linearization | None]:
        rate, block = self._loop.flow(
            t, self._packer.unpack(y), mode, reference, coefficients, linearize, noise
        )
        return self._packer.pack(rate), block

    def _advance(
        self,
        t: Tensor,
        h: Tensor,
        carry: Carry,
        reference: Reference,
        coefficients: Coefficients,
        noise: Measurement | None,
        moving: Tensor | None,
    ) -> Carry:
        y, mode = carry.y, carry.mode
        if mode is not None:
            state, mode = self._loop.jump(t, self._packer.unpack(y), mode, reference, noise)
            if self._loop.controller.reallocates:
                y = self._packer.pack(state)
        torque = None
        if self._effort:
            torque = self._loop.observe(t, self._packer.unpack(y), mode, reference, noise).torque
        flow = _FlatFlow(self._rates, (mode, reference, coefficients, noise), moving)
        y = self._solver.step(flow, t, h, y)
        # NaN compares as False, so that this catches it too.
        return Carry(y, mode, y.abs().amax(dim=-1) < self._limit, torque)

    def without_dead(
        self,
        t: Tensor,
        h: Tensor,
        carry: Carry,
        safe: Tensor,
        reference: Reference,
        coefficients: Coefficients,
        noise: Measurement | None = None,
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
            after = self(t, h, carry._replace(y=y), reference, coefficients, noise, alive)
            still = alive & after.alive
            fallen = torch.where((alive & ~still).unsqueeze(-1), after.y.detach(), fallen)
            if bool((still == alive).all()):
                break
            alive = still
        y = torch.where(alive.unsqueeze(-1), after.y, carry.y)
        mode = map_tensors(lambda new, old: pick(alive, new, old), after.mode, carry.mode)
        return Carry(y, mode, alive, after.torque), fallen
