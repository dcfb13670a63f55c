"""One number that flows linearly, switches its law at a threshold or is reset there."""

from __future__ import annotations

import functools
from typing import NamedTuple

import torch
from torch import Tensor

from mann_torch.compiled import (
    EVENT_LEAVES,
    Arguments,
    EventProgram,
    Job,
    Layout,
    Leaf,
    Places,
    march,
)
from mann_torch.compiled.march.agreement import check_agreement, row_of
from mann_torch.functional import pick
from mann_torch.simulation.events.steps import EventCounts, hybrid_step
from mann_torch.types import MemoryMode, Proximity


class Toy(NamedTuple):
    """x' = a_i - k_i x; branch 1 above the threshold c, branch 0 below (one branch: never).

    With `gain`, x jumps to gain x + shift whenever it reaches c. Constants are () or (...,).
    """

    a: list[Tensor]
    k: list[Tensor]
    c: Tensor
    gain: Tensor | None = None
    shift: float = 0.0

    def flow(self, t: Tensor, h: Tensor, y: Tensor, weights: Tensor, mode: MemoryMode) -> Tensor:
        parts = weights.unbind(-1)
        a = sum((w * v for w, v in zip(parts, self.a, strict=True)), torch.zeros_like(h))
        k = sum((w * v for w, v in zip(parts, self.k, strict=True)), torch.zeros_like(h))
        x = y[..., 0]
        still = k.detach() == 0
        safe = torch.where(still, 1.0, k)
        moved = torch.where(still, h, -torch.expm1(-safe * h) / safe)
        return (x + (a - k * x) * moved).unsqueeze(-1)

    def proximity(self, t: Tensor, y: Tensor, mode: MemoryMode) -> Proximity:
        past = y[..., 0] - self.c
        nowhere = torch.full_like(past, -torch.inf)
        columns = [past, torch.zeros_like(past)][: len(self.a)]
        return Proximity(torch.stack(columns, -1), nowhere if self.gain is None else past)

    def reset(
        self, t: Tensor, y: Tensor, mode: MemoryMode, due: Tensor
    ) -> tuple[Tensor, MemoryMode]:
        assert self.gain is not None
        y = pick(due, (self.gain * y[..., 0] + self.shift).unsqueeze(-1), y)
        return y, mode._replace(reallocations=mode.reallocations + due)

    def mode(self, batch: tuple[int, ...] = ()) -> MemoryMode:
        count = torch.zeros(batch, dtype=torch.int64)
        active = torch.ones(*batch, len(self.a), dtype=torch.bool)
        return MemoryMode(active, count - 1, count, count)

    def run(
        self, x: Tensor, times: Tensor, engine: str = "torch"
    ) -> tuple[Tensor, MemoryMode, EventCounts]:
        """x (...,) at the last of the step times (T+1,), hybrid."""
        if engine == "compiled":
            return self._run_compiled(x, times)
        y, mode = x.unsqueeze(-1), self.mode(tuple(x.shape))
        total = EventCounts(*(torch.zeros(x.shape, dtype=torch.int64) for _ in range(3)))
        for t, h in zip(times[:-1], times.diff(), strict=True):
            y, mode, counts = hybrid_step(self, t, h, y, mode)
            total = EventCounts(*(a + b for a, b in zip(total, counts, strict=True)))
        return y[..., 0], mode, total

    def _run_compiled(self, x: Tensor, times: Tensor) -> tuple[Tensor, MemoryMode, EventCounts]:
        batch, n, slots = x.numel(), len(times) - 1, len(self.a)
        given = [*self.a, *self.k, self.c, *([] if self.gain is None else [self.gain])]
        rows = torch.stack([v.expand(x.shape).reshape(-1) for v in given], dim=-1)
        program = program_of(slots, self.gain is not None, self.shift)
        last = torch.full((n + 1,), -1, dtype=torch.int32)
        last[-1] = 0
        job = Job(
            program=program,
            clock=torch.stack([times[:-1], times.diff()], dim=-1),
            segment_of=torch.zeros(n, dtype=torch.int32),
            noise=None,
            whole=torch.zeros(batch, 0, dtype=torch.int64),
            carry_k=row_of(_carry(slots), False).expand(batch, -1).contiguous(),
            motion_slot=last,
            state_slot=torch.full_like(last, -1),
            limit=1e8,
            tape_memory=1e8,
            wanted=(tuple(range(len(program.used))), ()),
        )
        check_agreement(program, job.lanes_used, job.wanted)
        segments = torch.zeros(1, batch, 0, dtype=torch.float64)
        found = march(job, rows[:, list(program.used)], segments, x.reshape(-1, 1))
        active, integers, counts, _ = found.last_k.split([slots, 3, 3, 7], dim=-1)
        mode = MemoryMode(
            (active != 0).reshape(*x.shape, slots),
            *(i.reshape(x.shape) for i in integers.unbind(-1)),
        )
        met = EventCounts(*(c.reshape(x.shape) for c in counts.unbind(-1)))
        return found.motion[0, :, 0].reshape(x.shape), mode, met

    def run_plainly(self, x: Tensor, times: Tensor) -> Tensor:
        """The same by steps that locate nothing: what plain automatic differentiation sees."""
        for t, h in zip(times[:-1], times.diff(), strict=True):
            past = x.detach() >= self.c
            if self.gain is not None:
                x = torch.where(past, self.gain * x + self.shift, x)
            branch = past.long() if len(self.a) > 1 else torch.zeros_like(past).long()
            weights = torch.eye(len(self.a), dtype=torch.float64)[branch]
            x = self.flow(t, h, x.unsqueeze(-1), weights, self.mode())[..., 0]
        return x


def _carry(slots: int) -> list[Tensor]:
    """x = 0.1, the mode at the start, counts and notes."""
    mode = MemoryMode(torch.ones(slots, dtype=torch.bool), *torch.tensor([-1, 0, 0]).unbind())
    extra = [torch.zeros(leaf.shape, dtype=torch.int64) for leaf in EVENT_LEAVES]
    return [torch.tensor([0.1], dtype=torch.float64), *mode[:4], *extra]


@functools.cache
def program_of(slots: int, resets: bool, shift: float) -> EventProgram:
    """One program for all toys of a form; the numbers of its examples do not matter."""
    numbers = torch.linspace(0.4, 0.9, 2 * slots + 1 + resets, dtype=torch.float64).unbind()
    a, k, more = numbers[:slots], numbers[slots : 2 * slots], numbers[2 * slots :]
    toy = Toy(list(a), list(k), more[0], more[1] if resets else None, shift)
    layout = Layout(
        clock=2,
        constants=(Leaf(()),) * len(numbers),
        segments=(),
        noise=(),
        carry=(Leaf((1,)), Leaf((slots,), "b"), *[Leaf((), "i")] * 3, *EVENT_LEAVES),
        n_motion=1,
        watched=(0,),
    )
    clock = torch.tensor([0.0, 0.01], dtype=torch.float64).unbind()
    return EventProgram(ToyStep(toy), layout, [*clock, *numbers, *_carry(slots)])


class ToyStep:
    """A toy's hybrid step as the compiler takes it."""

    places = Places(attended=2, switches=3)

    def __init__(self, toy: Toy) -> None:
        self._toy, self.n_branches = toy, len(toy.a)

    def _within(self, given: Arguments) -> tuple[Toy, Tensor, MemoryMode]:
        n, constants = self.n_branches, given.constants
        toy = self._toy._replace(a=constants[:n], k=constants[n : 2 * n], c=constants[2 * n])
        if toy.gain is not None:
            toy = toy._replace(gain=constants[-1])
        return toy, given.carry[0], MemoryMode(*given.carry[1:5])

    def held(self, t: Tensor, h: Tensor, weights: Tensor, given: Arguments) -> list[Tensor]:
        toy, y, mode = self._within(given)
        return [toy.flow(t, h, y, weights, mode)]

    def near(self, t: Tensor, given: Arguments) -> Proximity:
        toy, y, mode = self._within(given)
        return toy.proximity(t, y, mode)

    def reset(self, t: Tensor, given: Arguments) -> list[Tensor]:
        toy, y, mode = self._within(given)
        if toy.gain is None:
            return given.carry
        y, mode = toy.reset(t, y, mode, torch.ones((), dtype=torch.bool))
        return [y, *mode[:4], *given.carry[5:]]

    def totals(self, given: Arguments, after: list[Tensor]) -> list[Tensor]:
        return after

    def __call__(self, given: Arguments) -> list[Tensor]:
        toy, y, mode = self._within(given)
        y, mode, met = hybrid_step(toy, *given.clock, y, mode)
        return [y, *mode[:4], given.carry[5] + torch.stack(met), given.carry[6]]
