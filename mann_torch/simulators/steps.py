"""Steps of a batch of episodes: compiled where they can be, in eager torch elsewhere."""

from __future__ import annotations

import torch
from torch import Tensor

from ..compiled import UntraceableError
from ..errors import ConfigError, KernelError
from ..functional import pick
from ..signals import Surroundings
from ..simulation import ClosedLoop, Solver
from ..simulation.conditions import Conditions
from ..simulation.engines.stepping import Carry, Stepper
from ..trees import Packer, map_tensors
from ..types import LoopState
from .compiled_steps import CompiledSteps


class Steps:
    """Steps of a loop: samples that are not alive, or fall, stay where they are.

    `obstacle` is why eager torch takes them; None: they are compiled, and `insisted` says that
    nothing else will do: then what can't be traced raises `ConfigError`, or `KernelError`.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        solver: Solver,
        packer: Packer[LoopState],
        limit: float,
        obstacle: str | None,
        insisted: bool,
    ) -> None:
        self._stepper = Stepper(loop, solver, packer, limit)
        self._limit, self._insisted = limit, insisted
        self.obstacle, self._compiled = obstacle, CompiledSteps(loop, solver, packer)

    def renew(self, signals: Surroundings) -> None:
        """Other signals (B, ...) from now on."""
        self._compiled.renew(signals)

    def __call__(self, t: Tensor, h: Tensor, carry: Carry, here: Conditions) -> Carry:
        """After steps of h (B,) [s] from t (B,) [s] on."""
        if self.obstacle is None:
            try:
                return self._in_a_kernel(t, h, carry, here)
            except (KernelError, UntraceableError) as error:
                if self._insisted:
                    raise ConfigError(f"engine = 'compiled': {error}; take 'torch'") from error
                self.obstacle = str(error)
        if bool(carry.alive.all()):
            after = self._stepper(t, h, carry, here)
            if bool(after.alive.all()):
                return after
        return self._stepper.without_dead(t, h, carry, torch.zeros_like(carry.y), here)[0]

    def _in_a_kernel(self, t: Tensor, h: Tensor, carry: Carry, here: Conditions) -> Carry:
        """The compiled step; a sample's NaN reaches no other."""
        y, mode = self._compiled(t, h, carry, here)
        alive = carry.alive & (y.abs().amax(dim=-1) < self._limit)
        if not bool(alive.all()):
            y = pick(alive, y, carry.y)
            mode = map_tensors(lambda new, old: pick(alive, new, old), mode, carry.mode)
        return Carry(y, mode, alive)
