"""Steps of a batch of episodes: compiled where they can be, in eager torch elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from ..compiled import UntraceableError
from ..errors import ConfigError, KernelError
from ..signals import Surroundings
from ..simulation import ClosedLoop, Solver
from ..simulation.engines.stepping import Carry, Stepper
from ..trees import Packer
from ..types import LoopState
from .compiled_steps import CompiledSteps, Piece


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
        self._insisted = insisted
        self.obstacle, self._compiled = obstacle, CompiledSteps(loop, solver, packer, limit)

    def renew(self, signals: Surroundings) -> None:
        """Other signals (B, ...) from now on."""
        self._compiled.renew(signals)

    def __call__(self, pieces: Sequence[Piece], carry: Carry) -> Carry:
        """After all pieces, one after the other."""
        if self.obstacle is None:
            try:
                return self._compiled(pieces, carry)
            except (KernelError, UntraceableError) as error:
                if self._insisted:
                    raise ConfigError(f"engine = 'compiled': {error}; take 'torch'") from error
                self.obstacle = str(error)
        for piece in pieces:
            on = carry.alive & piece.moving
            after = self._moved(piece, carry._replace(alive=on))
            carry = after._replace(alive=after.alive | (carry.alive & ~piece.moving))
        return carry

    def _moved(self, piece: Piece, carry: Carry) -> Carry:
        """In eager torch; a sample that fell is alive no more."""
        t, h, _, here = piece
        if bool(carry.alive.all()):
            after = self._stepper(t, h, carry, here)
            if bool(after.alive.all()):
                return after
        return self._stepper.without_dead(t, h, carry, torch.zeros_like(carry.y), here)[0]
