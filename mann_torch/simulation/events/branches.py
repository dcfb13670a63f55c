"""A closed loop with its attention held, as `events/steps.hybrid_step` takes it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from ...functional import one_hot
from ...plants.plant import Coefficients
from ...signals import Sampler
from ...trees import Packer
from ...types import LoopState, Measurement, MemoryMode, Proximity
from ..closed_loop import ClosedLoop
from ..solvers.flat_flow import FlatFlow, flat_rates
from ..solvers.solver import Solver


@dataclass(frozen=True)
class Branches:
    """The loop on flat states y (..., M), each sample at a time t (...,) [s] of its own."""

    loop: ClosedLoop
    solver: Solver
    packer: Packer[LoopState]
    reference: Sampler
    coefficients: Coefficients
    noise: Measurement | None  # on what is measured in this step
    moving: Tensor | None  # (...,) bool; the others stand still

    def flow(self, t: Tensor, h: Tensor, y: Tensor, weights: Tensor, mode: MemoryMode) -> Tensor:
        """One solver step of length h (...,) [s] with the slots' weights (..., S) held."""
        frozen = (mode._replace(held=weights), self.reference, self.coefficients, self.noise)
        flow = FlatFlow(partial(flat_rates, self.loop, self.packer), frozen, self.moving)
        return self.solver.step(flow, t, h, y)

    def proximity(self, t: Tensor, y: Tensor, mode: MemoryMode) -> Proximity:
        """What decides the next event."""
        return self.loop.proximity(t, self.packer.unpack(y), mode, self.reference, self.noise)

    def reset(
        self, t: Tensor, y: Tensor, mode: MemoryMode, due: Tensor
    ) -> tuple[Tensor, MemoryMode]:
        """The slot that attention gives up is written anew, in the samples `due`."""
        before = self.packer.unpack(y)
        state, mode = self.loop.reallocate(t, before, mode, self.reference, due, self.noise)
        return self.packer.pack(state), mode

    def torque(self, t: Tensor, y: Tensor, mode: MemoryMode) -> Tensor:
        """Torque (..., n) [N m] under the attended branch alone."""
        held = one_hot(mode.attended, mode.active.shape[-1]).to(torch.float64)
        mode = mode._replace(held=held)
        state = self.packer.unpack(y)
        return self.loop.observe(t, state, mode, self.reference, self.noise).torque
