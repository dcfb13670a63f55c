"""A closed loop's step as the compiler takes it: a function of one sample's tensors."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple, Self

import torch
from torch import Tensor

from ...compiled import Arguments, Layout, Leaf, Program, UntraceableError, frozen, with_tensors
from ...constraints import held_tensors
from ...signals import Surroundings
from ...trees import Packer, leaves, map_tensors, rebuilt, structure
from ...types import LoopMode, LoopState
from ..conditions import Conditions, Span, Ticks
from ..solvers.flat_flow import flat_rates
from ..step_grid import MERGE
from ..task import Task
from .stepping import advance

#: Numbers of the clock: time, step, the next time and its share; with effort also one over the
#: step before, and whether peaks count; with signals that jump the step's span; with a clock or a
#: sensor whether each of them ticks.
CLOCK, EFFORT_CLOCK, SPAN, TICKS = 4, 2, 2, 2


class Bound(NamedTuple):
    """What a step reads besides its loop."""

    conditions: Conditions
    horizon: Tensor


class LoopStep:
    """The step of a task: jump, flow, and what is summed up on the way.

    Carry, in this order: the plant's state, the integral of squared error, what a reference model
    gives, with effort the integral of squared input rates, the peaks and the last input; the rest
    of the state; the mode.
    """

    #: What the compiler makes of it.
    program: type[Program] = Program

    def __init__(
        self,
        task: Task,
        surroundings: Surroundings,
        coefficients: Any,
        loop_names: Sequence[str],
        outside_names: Sequence[str],
    ) -> None:
        self._loop, self._outside, self._solver = task.loop, surroundings, task.solver
        depth = len(task.batch)

        def first(leaf: Tensor) -> Tensor:
            return leaf[(0,) * depth].detach()

        self._state: LoopState = map_tensors(first, task.state)
        self._mode: LoopMode = map_tensors(first, task.mode)
        self._coefficients = coefficients
        self._loop_names, self._outside_names = loop_names, outside_names
        self._effort, self._ticks = task.effort_after is not None, task.ticks is not None
        self._spans = task.spans is not None
        self._noise = 0 if task.noise is None else task.noise.std.shape[-1]
        self._packer = Packer(self._state, 0)
        self.n_plant = len(leaves(self._state.plant))
        self.sum_widths = [task.n_outputs] * (1 if task.loop.model is None else 2)
        self.sum_widths += [task.n_inputs] * (3 if self._effort else 0)
        self.n_sums = len(self.sum_widths)

    def freeze(self) -> Self:
        """Keep to copies of loop, signals and solver: nobody else sees them traced or changed."""
        self._loop, self._outside = frozen(self._loop), frozen(self._outside)
        self._solver = copy.copy(self._solver)
        return self

    def layout(self, constants: Sequence[Tensor], segments: Sequence[Tensor]) -> Layout:
        """Of constants and coefficients as one sample has them."""
        state, mode = leaves(self._state), leaves(self._mode)
        plant, sums = self.n_plant, self.n_sums
        rows = [torch.zeros(width, dtype=torch.float64) for width in self.sum_widths]
        tensors = [*state[:plant], *rows, *state[plant:], *mode]
        recorded = [x.numel() for x in state[:plant]] + self.sum_widths
        return Layout(
            clock=CLOCK + EFFORT_CLOCK * self._effort + SPAN * self._spans + TICKS * self._ticks,
            constants=tuple(Leaf.of(c) for c in constants),
            segments=tuple(tuple(s.shape) for s in segments),
            noise=((self._noise,),) if self._noise else (),
            carry=tuple(Leaf.of(x) for x in tensors),
            # All but the last input, which only the next step reads.
            n_motion=sum(recorded[: len(recorded) - self._effort]),
            watched=(*range(plant), *range(plant + sums, sums + len(state))),
        )

    @property
    def measures(self) -> bool:
        """Whether effort is summed up."""
        return self._effort

    def form(self) -> tuple[Any, ...]:
        """Which members of state, mode and coefficients there are."""
        return tuple(structure(x) for x in (self._state, self._mode, self._coefficients))

    def split(self, carry: Sequence[Tensor]) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
        """State leaves, sums, and mode leaves."""
        first, count = self.n_plant, len(leaves(self._state))
        last = first + self.n_sums
        end = self.n_sums + count
        return [*carry[:first], *carry[last:end]], list(carry[first:last]), list(carry[end:])

    def extra(self, count: int) -> list[Tensor]:
        """What else the carry holds at the start, (count, *event) each."""
        return []

    def join(
        self, state: Sequence[Tensor], sums: Sequence[Tensor], mode: Sequence[Tensor]
    ) -> list[Tensor]:
        """The inverse of `split`."""
        return [*state[: self.n_plant], *sums, *state[self.n_plant :], *mode]

    def __call__(self, given: Arguments) -> list[Tensor]:
        """The next carry."""
        with self._bound(given) as here:
            (t, h), (state, sums, mode_leaves) = given.clock[:2], self.split(given.carry)
            rates = partial(flat_rates, self._loop, self._packer)
            y, mode, commanded = advance(
                self._loop, self._solver, self._packer, rates, self._effort, t, h,
                self._packer.pack(rebuilt(self._state, state)), rebuilt(self._mode, mode_leaves),
                here.conditions,
            )  # fmt: skip
            after = self._packer.unpack(y)
            found = self._summed(given.clock, sums, after, commanded, here)
        return self.join(leaves(after), found, leaves(mode))

    @contextmanager
    def _bound(self, given: Arguments) -> Iterator[Bound]:
        """Let loop and signals hold these tensors."""
        clock, constants = given.clock, given.constants
        count = len(self._loop_names)
        last = count + len(self._outside_names)
        own = dict(zip(self._loop_names, constants[:count], strict=True))
        signal = dict(zip(self._outside_names, constants[count:last], strict=True))
        measured = given.noise[0] * constants[last + 1] if self._noise else None
        ticks = Ticks(*(x > 0.5 for x in clock[-TICKS:])) if self._ticks else None
        coefficients = rebuilt(self._coefficients, given.segments)
        begin = CLOCK + EFFORT_CLOCK * self._effort
        span = Span(*clock[begin : begin + SPAN]) if self._spans else None
        here = Conditions(self._outside, coefficients, measured, ticks, span)
        with with_tensors(self._loop, own), with_tensors(self._outside, signal):
            yield Bound(here, constants[last])
            for module, bound in ((self._loop, own), (self._outside, signal)):
                held = held_tensors(module)
                for name, tensor in bound.items():
                    if held.get(name) is not tensor:
                        raise UntraceableError(f"steps put another tensor into {name}")

    def _summed(
        self,
        clock: Sequence[Tensor],
        sums: Sequence[Tensor],
        state: LoopState,
        commanded: Tensor | None,
        here: Bound,
    ) -> list[Tensor]:
        """The sums at a step's end, from the state there and the input at its start."""
        t, h, t_next, share = clock[:CLOCK]
        # t + h is where the solver's last stage was: its reference is not computed twice. One that
        # jumps there is another.
        end = t_next if self._spans else t + h
        error, followed = self._loop.error(end, state, here.conditions)
        counted = t_next <= here.horizon + MERGE
        found = [sums[0] + torch.where(counted, share, 0.0) * error.square()]
        if self._loop.model is not None:
            found.append(followed)
        if commanded is not None:
            found += _effort(sums[-3:], commanded, counted, clock[CLOCK : CLOCK + EFFORT_CLOCK])
        return found


def _effort(
    sums: Sequence[Tensor], u: Tensor, counted: Tensor, clock: Sequence[Tensor]
) -> list[Tensor]:
    """Squared rates, peaks, and the input itself: see `task.Effort`."""
    rate, peak, before = sums
    per_step, late = clock
    change = (u - before).square()
    rate = rate + torch.where(counted, per_step, 0.0) * change
    size = u.abs()
    higher = counted & (late > 0.5) & (size > peak)
    return [rate, torch.where(higher, size, peak), u]
