"""A closed loop's step as the compiler takes it: a function of one sample's tensors."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple, Self

import torch
from torch import Tensor

from ...compiled import Layout, Leaf, Program, UntraceableError, frozen, with_tensors
from ...plants.plant import Coefficients
from ...signals import Reference, scaled
from ...trees import Packer, leaves, map_tensors, rebuilt
from ...types import LoopState, Measurement, Mode
from ..solvers.flat_flow import flat_rates
from ..step_grid import MERGE
from ..task import Task
from .loop_parts import held_tensors
from .stepping import advance

#: Numbers of the clock: time, step, the next time and its share; with effort also one over the
#: step before, and whether peaks count.
CLOCK, EFFORT_CLOCK = 4, 2


class Bound(NamedTuple):
    """What a step reads besides its loop and its reference."""

    coefficients: Coefficients
    noise: Measurement | None
    horizon: Tensor


class LoopStep:
    """The step of a task: jump, flow, and what is summed up on the way.

    Carry, in this order: q and qd, the integral of squared error, with effort the integral of
    squared torque rates, the peaks and the last torque; the rest of the state; the mode.
    """

    #: What the compiler makes of it.
    program: type[Program] = Program

    def __init__(
        self,
        task: Task,
        reference: Reference,
        coefficients: Any,
        loop_names: Sequence[str],
        reference_names: Sequence[str],
    ) -> None:
        self._loop, self._reference, self._solver = task.loop, reference, task.solver
        depth = len(task.batch)

        def first(leaf: Tensor) -> Tensor:
            return leaf[(0,) * depth].detach()

        self._state: LoopState = map_tensors(first, task.state)
        self._mode: Mode = map_tensors(first, task.mode)
        self._coefficients = coefficients
        self._loop_names, self._reference_names = loop_names, reference_names
        self._effort, self._noise = task.effort_after is not None, task.noise is not None
        self._packer = Packer(self._state, 0)
        self.n_sums = 4 if self._effort else 1

    def freeze(self) -> Self:
        """Keep to copies of loop, reference and solver: nobody else sees them traced or changed."""
        self._loop, self._reference = frozen(self._loop), frozen(self._reference)
        self._solver = copy.copy(self._solver)
        return self

    def layout(self, constants: Sequence[Tensor], segments: Sequence[Tensor]) -> Layout:
        """Of constants and coefficients as one sample has them."""
        n = self._state.plant.q.shape[-1]
        state, mode = leaves(self._state), leaves(self._mode)
        sums = self.n_sums
        tensors = [*state[:2], *[state[0]] * sums, *state[2:], *mode]
        rest = range(2 + sums, sums + len(state))
        return Layout(
            clock=CLOCK + EFFORT_CLOCK * self._effort,
            constants=tuple(_leaf(c) for c in constants),
            segments=tuple(tuple(s.shape) for s in segments),
            noise=((2 * n,),) if self._noise else (),
            carry=tuple(_leaf(x) for x in tensors),
            n_motion=n * (5 if self._effort else 3),
            watched=(0, 1, *rest),
        )

    def form(self) -> tuple[Any, ...]:
        """Which members of state, mode and coefficients there are."""
        return tuple(_structure(x) for x in (self._state, self._mode, self._coefficients))

    def split(self, carry: Sequence[Tensor]) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
        """State leaves, sums, and mode leaves."""
        sums, count = self.n_sums, len(leaves(self._state))
        state = [*carry[:2], *carry[2 + sums : sums + count]]
        return state, list(carry[2 : 2 + sums]), list(carry[sums + count :])

    def extra(self, count: int) -> list[Tensor]:
        """What else the carry holds at the start, (count, *event) each."""
        return []

    def join(
        self, state: Sequence[Tensor], sums: Sequence[Tensor], mode: Sequence[Tensor]
    ) -> list[Tensor]:
        """The inverse of `split`."""
        return [*state[:2], *sums, *state[2:], *mode]

    def __call__(
        self,
        clock: Sequence[Tensor],
        constants: Sequence[Tensor],
        segments: Sequence[Tensor],
        noise: Sequence[Tensor],
        carry: Sequence[Tensor],
    ) -> list[Tensor]:
        """The next carry."""
        with self._bound(constants, segments, noise) as here:
            state, sums, mode_leaves = self.split(carry)
            rates = partial(flat_rates, self._loop, self._packer)
            y, mode, torque = advance(
                self._loop, self._solver, self._packer, rates, self._effort, clock[0], clock[1],
                self._packer.pack(rebuilt(self._state, state)), rebuilt(self._mode, mode_leaves),
                self._reference, here.coefficients, here.noise,
            )  # fmt: skip
            after = self._packer.unpack(y)
            found = self._summed(clock, sums, after.plant.q, torque, here.horizon)
        return self.join(leaves(after), found, leaves(mode))

    @contextmanager
    def _bound(
        self, constants: Sequence[Tensor], segments: Sequence[Tensor], noise: Sequence[Tensor]
    ) -> Iterator[Bound]:
        """Let loop and reference hold these tensors."""
        count = len(self._loop_names)
        last = count + len(self._reference_names)
        own = dict(zip(self._loop_names, constants[:count], strict=True))
        signal = dict(zip(self._reference_names, constants[count:last], strict=True))
        measured = scaled(noise[0], constants[last + 1]) if self._noise else None
        coefficients = rebuilt(self._coefficients, segments)
        with with_tensors(self._loop, own), with_tensors(self._reference, signal):
            yield Bound(coefficients, measured, constants[last])
            for module, given in ((self._loop, own), (self._reference, signal)):
                held = held_tensors(module)
                for name, tensor in given.items():
                    if held.get(name) is not tensor:
                        raise UntraceableError(f"steps put another tensor into {name}")

    def _summed(
        self,
        clock: Sequence[Tensor],
        sums: Sequence[Tensor],
        q: Tensor,
        torque: Tensor | None,
        horizon: Tensor,
    ) -> list[Tensor]:
        """The sums at a step's end, from the joints there and the torque at its start."""
        t, h, t_next, share = clock[:CLOCK]
        # t + h is where the solver's last stage was: its reference is not computed twice.
        error = self._reference(t + h).q - q
        counted = t_next <= horizon + MERGE
        found = [sums[0] + torch.where(counted, share, 0.0) * error.square()]
        if torque is not None:
            found += _effort(sums[1:], torque, counted, clock[CLOCK:])
        return found


def _effort(
    sums: Sequence[Tensor], torque: Tensor, counted: Tensor, clock: Sequence[Tensor]
) -> list[Tensor]:
    """Squared rates, peaks, and the torque itself: see `task.Effort`."""
    rate, peak, before = sums
    per_step, late = clock
    change = (torque - before).square()
    rate = rate + torch.where(counted, per_step, 0.0) * change
    size = torque.abs()
    higher = counted & (late > 0.5) & (size > peak)
    return [rate, torch.where(higher, size, peak), torque]


def _leaf(x: Tensor) -> Leaf:
    kind = "f" if x.is_floating_point() else "b" if x.dtype == torch.bool else "i"
    return Leaf(tuple(x.shape), kind)


def _structure(tree: Any) -> Any:
    if tree is None or isinstance(tree, Tensor):
        return tree is not None
    return (type(tree).__qualname__, *(_structure(branch) for branch in tree))
