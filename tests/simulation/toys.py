"""One number that flows linearly, switches its law at a threshold or is reset there."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from mann_torch.functional import pick
from mann_torch.simulation.events import EventCounts, hybrid_step
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

    def run(self, x: Tensor, times: Tensor) -> tuple[Tensor, MemoryMode, EventCounts]:
        """x (...,) at the last of the step times (T+1,), hybrid."""
        y, mode = x.unsqueeze(-1), self.mode(tuple(x.shape))
        total = EventCounts(*(torch.zeros(x.shape, dtype=torch.int64) for _ in range(3)))
        for t, h in zip(times[:-1], times.diff(), strict=True):
            y, mode, counts = hybrid_step(self, t, h, y, mode)
            total = EventCounts(*(a + b for a, b in zip(total, counts, strict=True)))
        return y[..., 0], mode, total

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
