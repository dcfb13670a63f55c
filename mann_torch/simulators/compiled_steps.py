"""Steps of a batch of episodes on the compiled engine, each sample at its own time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import torch
from torch import Tensor

from ..compiled import (
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


class PeriodStep:
    """One step of one sample: (time and size, ticks, span, noise, coefficients) -> (y, mode)."""

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

    def __call__(
        self,
        clock: Sequence[Tensor],
        constants: Sequence[Tensor],
        segments: Sequence[Tensor],
        noise: Sequence[Tensor],
        carry: Sequence[Tensor],
    ) -> list[Tensor]:
        """The next carry."""
        own, outer = self._names
        first = dict(zip(own, constants[: len(own)], strict=True))
        second = dict(zip(outer, constants[len(own) :], strict=True))
        loop, (t, h) = self._loop, segments[0].unbind()
        given = iter(segments[2:])
        ticks = Ticks(*(x > 0.5 for x in segments[1].unbind()))
        span = None if self._here.span is None else Span(*next(given).unbind())
        measured = None if self._here.noise is None else next(given)
        coefficients = rebuilt(self._here.coefficients, list(given))
        here = Conditions(self._signals, coefficients, measured, ticks, span)
        rates = partial(flat_rates, loop, self._packer)
        with with_tensors(loop, first), with_tensors(self._signals, second):
            y, mode, _ = advance(
                loop, self._solver, self._packer, rates, False, t, h, carry[0],
                rebuilt(self._mode, carry[1:]), here,
            )  # fmt: skip
        return [y, *leaves(mode)]


class CompiledSteps:
    """Steps of all samples in one kernel call.

    Raises `UntraceableError` or `KernelError` when it is first called.
    """

    def __init__(self, loop: ClosedLoop, solver: Solver, packer: Packer[LoopState]) -> None:
        self.loop, self.solver, self.packer = loop, solver, packer
        self.signals: Surroundings
        self._form: Any = None
        self._program: Program
        self._single: Single

    def renew(self, signals: Surroundings) -> None:
        """Other signals (B, ...) from now on."""
        self.signals, self._form = signals, None

    def __call__(
        self, t: Tensor, h: Tensor, carry: Carry, here: Conditions
    ) -> tuple[Tensor, LoopMode]:
        """State (B, M) and mode after steps of h (B,) [s] from t (B,) [s] on."""
        B = len(t)
        segments = self._segments(t, h, here)
        state = [carry.y, *leaves(carry.mode)]
        form = structure(here.coefficients), here.noise is None, here.span is None
        if form != self._form:
            self._make(segments, carry, state, here, form)
            self._form = form
        torch.cat([x.reshape(B, -1) for x in segments], dim=-1, out=self._single.segments)
        whole = [x for x in state if not x.is_floating_point()]
        f = torch.cat([x.reshape(B, -1) for x in state if x.is_floating_point()], dim=-1)
        k = [(-x.long() if x.dtype == torch.bool else x).reshape(B, -1) for x in whole]
        packed = self._single.packed(f, torch.cat([f.new_zeros(B, 0, dtype=torch.int64), *k], -1))
        f, integers = self._single.unpacked(self._single(packed))
        after = self._program.layout.carried(f, integers, (B,))
        return after[0], rebuilt(carry.mode, after[1:])

    def _segments(self, t: Tensor, h: Tensor, here: Conditions) -> list[Tensor]:
        """What a step is under, each (B, *event)."""
        flags = [torch.as_tensor(x).to(t.dtype).expand(t.shape) for x in here.ticks or ()]
        found = [torch.stack([t, h], dim=-1), torch.stack(flags, dim=-1)]
        if here.span is not None:
            found.append(torch.stack(list(here.span), dim=-1))
        if here.noise is not None:
            found.append(here.noise)
        return found + [batched(leaf, t.shape) for leaf in leaves(here.coefficients)]

    def _make(
        self,
        segments: Sequence[Tensor],
        carry: Carry,
        state: Sequence[Tensor],
        here: Conditions,
        form: Any,
    ) -> None:
        """The program of steps of this form, and constants as they are."""
        B = len(carry.y)
        own, outer = held_tensors(self.loop), held_tensors(self.signals)
        wider = held_tensors(self.signals.expand((1, B)))
        constants = [Row(x.expand(B, *x.shape), False) for x in own.values()]
        for name, x in outer.items():
            own_row = wider[name].dim() == x.dim() + 1
            constants.append(Row(x if own_row else x.expand(B, *x.shape), False))
        rows = Rows(constants, [x[None] for x in segments], list(state))
        names = list(own), list(outer)
        prints = Fingerprint()
        parts = (self.loop, self.solver, self.signals)
        key = (PeriodStep, *(prints.of(part) for part in parts), form, structure(carry.mode))
        self._program = program_of(key, prints, lambda: PeriodStep(self, names, carry, here), rows)
        job, tensors = job_of(self._program, rows)
        check_agreement(self._program, job.lanes_used)
        self._single = Single(job, *tensors)
