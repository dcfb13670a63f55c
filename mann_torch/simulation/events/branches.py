"""A closed loop with its attention held, as `events/steps.hybrid_step` takes it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from torch import Tensor

from ...functional import one_hot
from ...trees import Packer
from ...types import LoopMode, LoopState, MemoryMode, Proximity
from ..closed_loop import ClosedLoop
from ..conditions import Conditions
from ..solvers.flat_flow import FlatFlow, flat_rates
from ..solvers.solver import Solver


@dataclass(frozen=True)
class Branches:
    """The loop on flat states y (..., M), each sample at a time t (...,) [s] of its own."""

    loop: ClosedLoop
    solver: Solver
    packer: Packer[LoopState]
    here: Conditions
    moving: Tensor | None  # (...,) bool; the others stand still

    def flow(self, t: Tensor, h: Tensor, y: Tensor, weights: Tensor, mode: MemoryMode) -> Tensor:
        """One solver step of length h (...,) [s] with the slots' weights (..., S) held."""
        rates = partial(flat_rates, self.loop, self.packer)
        held = LoopMode(mode._replace(held=weights))
        return self.solver.step(FlatFlow(rates, held, self.here, self.moving), t, h, y)

    def proximity(self, t: Tensor, y: Tensor, mode: MemoryMode) -> Proximity:
        """What decides the next event."""
        return self.loop.proximity(t, self.packer.unpack(y), LoopMode(mode), self.here)

    def reset(
        self, t: Tensor, y: Tensor, mode: MemoryMode, due: Tensor
    ) -> tuple[Tensor, MemoryMode]:
        """The slot that attention gives up is written anew, in the samples `due`."""
        before = self.packer.unpack(y)
        state, after = self.loop.reallocate(t, before, LoopMode(mode), self.here, due)
        return self.packer.pack(state), after.controller

    def command(self, t: Tensor, y: Tensor, mode: MemoryMode) -> Tensor:
        """Input (..., m) under the attended branch alone."""
        held = one_hot(mode.attended, mode.active.shape[-1]).to(y.dtype)
        branch = LoopMode(mode._replace(held=held))
        return self.loop.commanded(t, self.packer.unpack(y), branch, self.here)
