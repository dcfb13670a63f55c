"""Steps of a batch of episodes on the compiled engine, each sample at its own time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..compiled import (
    Arguments,
    Fingerprint,
    Program,
    Row,
    Rows,
    Single,
    check_agreement,
    frozen,
    job_of,
    program_of,
    with_tensors,
)
from ..constraints import held_tensors
from ..signals import Surroundings
from ..simulation import ClosedLoop, Solver
from ..simulation.conditions import Conditions, Span, Ticks
from ..simulation.engines.loop_rows import batched
from ..simulation.engines.stepping import Carry, advance
from ..simulation.solvers.flat_flow import flat_rates
from ..trees import Packer, leaves, map_tensors, rebuilt, structure
from ..types import LoopMode, LoopState


class Piece(NamedTuple):
    """A step of a batch."""

    t: Tensor  # (B,) [s]
    h: Tensor  # (B,) [s]
    moving: Tensor  # (B,) bool, others stay where they are
    here: Conditions


class PieceStep:
    """A piece for one sample: (time, size and limit, flags, ...) -> (y, alive, mode)."""

    def __init__(
        self,
        steps: CompiledSteps,
        names: tuple[list[str], list[str]],
        like: Carry,
        here: Conditions,
    ) -> None:
        self._loop, self._signals = frozen(steps.loop), frozen(steps.signals)
        self._solver, self._packer, self._names = steps.solver, steps.packer, names
        self._mode: LoopMode = map_tensors(lambda x: x[0], like.mode)
        self._here = here

    def __call__(self, given: Arguments) -> list[Tensor]:
        """The next carry; a sample that would leave its range stays, and is alive no more."""
        own, outer = self._names
        first = dict(zip(own, given.constants[: len(own)], strict=True))
        second = dict(zip(outer, given.constants[len(own) :], strict=True))
        moment, flags, *more = given.segments
        loop, (t, h, limit) = self._loop, moment.unbind()
        moves, sensor, ticks = (x > 0.5 for x in flags.unbind())
        rest = iter(more)
        span = None if self._here.span is None else Span(*next(rest).unbind())
        measured = None if self._here.noise is None else next(rest)
        coefficients = rebuilt(self._here.coefficients, list(rest))
        here = Conditions(self._signals, coefficients, measured, Ticks(sensor, ticks), span)
        rates = partial(flat_rates, loop, self._packer)
        y, alive, *modes = given.carry
        mode: LoopMode = rebuilt(self._mode, modes)
        with with_tensors(loop, first), with_tensors(self._signals, second):
            after, then, _ = advance(
                loop, self._solver, self._packer, rates, False, t, h, y, mode, here
            )
        inside = (after.abs() < limit).all()
        goes = alive & moves & inside
        then = map_tensors(lambda new, old: torch.where(goes, new, old), then, mode)
        return [torch.where(goes, after, y), alive & (inside | ~moves), *leaves(then)]


class CompiledSteps:
    """Steps of all samples in one kernel call each.

    Raises `UntraceableError` or `KernelError` when it is first called.
    """

    def __init__(
        self, loop: ClosedLoop, solver: Solver, packer: Packer[LoopState], limit: float
    ) -> None:
        self.loop, self.solver, self.packer, self._limit = loop, solver, packer, limit
        self.signals: Surroundings
        self._form: Any = None
        self._program: Program
        self._single: Single

    def renew(self, signals: Surroundings) -> None:
        """Other signals (B, ...) from now on."""
        self.signals, self._form = signals, None

    def __call__(self, pieces: Sequence[Piece], carry: Carry) -> Carry:
        """After all pieces, one after the other."""
        packed: Tensor | None = None
        for piece in pieces:
            segments, here = self._segments(piece), piece.here
            form = structure(here.coefficients), here.noise is None, here.span is None
            if form != self._form:
                carry, packed = self._unpacked(packed, carry), None
                self._make(segments, carry, here, form)
                self._form = form
            if packed is None:
                packed = self._packed(carry)
            flat = [x.reshape(len(piece.t), -1) for x in segments]
            torch.cat(flat, dim=-1, out=self._single.segments)
            packed = self._single(packed)
        return self._unpacked(packed, carry)

    def _segments(self, piece: Piece) -> list[Tensor]:
        """What a step is under, each (B, *event)."""
        t, h, moving, here = piece
        flags = [moving, *(here.ticks or ())]
        rows = [torch.as_tensor(x).to(t.dtype).expand(t.shape) for x in flags]
        limit = torch.full_like(t, self._limit)
        found = [torch.stack([t, h, limit], dim=-1), torch.stack(rows, dim=-1)]
        if here.span is not None:
            found.append(torch.stack(list(here.span), dim=-1))
        if here.noise is not None:
            found.append(here.noise)
        return found + [batched(leaf, t.shape) for leaf in leaves(here.coefficients)]

    def _make(self, segments: Sequence[Tensor], carry: Carry, here: Conditions, form: Any) -> None:
        """The program of steps of this form, and constants as they are."""
        B = len(carry.y)
        own, outer = held_tensors(self.loop), held_tensors(self.signals)
        wider = held_tensors(self.signals.expand((1, B)))
        constants = [Row(x.expand(B, *x.shape), False) for x in own.values()]
        for name, x in outer.items():
            own_row = wider[name].dim() == x.dim() + 1
            constants.append(Row(x if own_row else x.expand(B, *x.shape), False))
        rows = Rows(constants, [x[None] for x in segments], _leaves(carry))
        names = list(own), list(outer)
        prints = Fingerprint()
        parts = (self.loop, self.solver, self.signals)
        key = (PieceStep, *(prints.of(part) for part in parts), form, structure(carry.mode))
        self._program = program_of(key, prints, lambda: PieceStep(self, names, carry, here), rows)
        job, tensors = job_of(self._program, rows)
        check_agreement(self._program, job.lanes_used)
        self._single = Single(job, *tensors)

    def _packed(self, carry: Carry) -> Tensor:
        """A carry as the kernel has it."""
        B, state = len(carry.y), _leaves(carry)
        f = [x.reshape(B, -1) for x in state if x.is_floating_point()]
        k = [-x.long() if x.dtype == torch.bool else x for x in state if not x.is_floating_point()]
        whole = torch.cat([x.reshape(B, -1) for x in k], dim=-1)
        return self._single.packed(torch.cat(f, dim=-1), whole)

    def _unpacked(self, packed: Tensor | None, like: Carry) -> Carry:
        """The inverse, in the form of a carry; None: that itself."""
        if packed is None:
            return like
        rows = self._program.layout.carried(*self._single.unpacked(packed), (len(like.y),))
        return Carry(rows[0], rebuilt(like.mode, rows[2:]), rows[1])


def _leaves(carry: Carry) -> list[Tensor]:
    return [carry.y, carry.alive, *leaves(carry.mode)]
