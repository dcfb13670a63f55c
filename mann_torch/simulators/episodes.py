"""Plants stepped from outside, a period a call: what environments are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..simulation import ClosedLoop, Observation, Solver
from ..simulation.conditions import Conditions, Span, Ticks
from ..simulation.engines.stepping import Carry
from ..simulation.jumping import jump
from ..trees import Packer, map_tensors
from ..types import LoopState
from .compiled_steps import Piece
from .episode import Course, Episode, course_of, put, rewritten, signals_of
from .given import Told
from .steps import Steps


class Moment(NamedTuple):
    """Where episodes are at the end of a period, a row each; what a reward is made of."""

    t: Tensor  # (B,) [s]
    state: Any  # of the plant, a field (B, d)
    error: Tensor  # (B, p) reference less output
    seen: Observation  # commanded and applied input, output, reference, measurement
    diverged: Tensor  # (B,) bool: held at the last state that was in range
    left: Tensor  # (B,) int64, periods to the horizon


class Episodes:
    """Episodes of one loop side by side, each at its own time, in one call of torch.

    The loop's clock ticks at the start of each period; its controller is a `GivenInput`. Steps
    within a period are a rollout's own, of the same solver on the same grid: see `Steps`.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        solver: Solver,
        episodes: Sequence[Episode],
        limit: float,
        obstacle: str | None = "asked for",
        insisted: bool = False,
    ) -> None:
        self._loop, self._episodes = loop, list(episodes)
        self._rows = torch.arange(len(self._episodes))
        self._packer: Packer[LoopState] = Packer(self._episodes[0].state, 0)
        self.steps = Steps(loop, solver, self._packer, limit, obstacle, insisted)
        self._carry: Carry
        self._course: Course
        self.begin(range(len(self._episodes)), self._episodes)

    @torch.no_grad()
    def begin(self, places: Sequence[int], episodes: Sequence[Episode]) -> None:
        """Begin other episodes at some places; the rest stay where they are."""
        changed = first = not hasattr(self, "_course")
        for place, episode in zip(places, episodes, strict=True):
            changed |= self._episodes[place] is not episode
            self._episodes[place] = episode
        if changed:
            if first or not rewritten(self._course, places, episodes):
                self._course = course_of(self._episodes)
            self._signals = signals_of(self._episodes)
            self.steps.renew(self._signals)
        flat = [self._packer.pack(episode.state) for episode in episodes]
        modes = [episode.mode for episode in episodes]
        fresh = torch.zeros(len(self._rows), dtype=torch.bool)
        fresh[list(places)] = True
        if bool(fresh.all()):
            mode = map_tensors(lambda *rows: torch.stack(rows), *modes)
            self._carry = Carry(torch.stack(flat), mode, fresh)
            self._period = torch.zeros_like(self._rows)
        else:
            y, mode = self._carry.y, self._carry.mode
            y, mode = put(y, places, flat), put(mode, places, modes)
            self._carry = Carry(y, mode, self._carry.alive | fresh)
            self._period = torch.where(fresh, 0, self._period)
        self._known: tuple[Tensor, Any] | None = None
        self._look(fresh)

    @torch.no_grad()
    def advance(self, u: Tensor, moving: Tensor) -> Moment:
        """Hold inputs u (B, m) for a period, in the episodes `moving` (B,) bool."""
        course, carry = self._course, self._carry
        told = Told(torch.where(moving.unsqueeze(-1), u, carry.mode.controller.input))
        carry = carry._replace(mode=carry.mode._replace(controller=told))
        first = course.begins[self._rows, self._period]
        later = course.begins[self._rows, self._period + moving]
        pieces = []
        for j in range(int((later - first).max())):
            k = first + j
            sampled = course.sampled[self._rows, self._within(k)] if j else False
            here = self._conditions(k)._replace(ticks=Ticks(sampled, j == 0))
            t = self._time(k)
            pieces.append(Piece(t, self._time(k + 1) - t, k < later, here))
        self._carry = self.steps(pieces, carry)
        self._period = self._period + moving
        return self._look(moving)

    def _look(self, fresh: Tensor) -> Moment:
        """What there is to see now; the sensor takes its sample in those that are `fresh` here."""
        loop, course, carry = self._loop, self._course, self._carry
        k = course.begins[self._rows, self._period]
        t, here = self._time(k), self._conditions(k)
        state = self._packer.unpack(carry.y)
        if loop.sensor is not None:
            sampled = course.sampled[self._rows, self._within(k)] & fresh & ~self.over
            ticking = here._replace(ticks=Ticks(sampled, False))
            carry = self._carry = carry._replace(mode=jump(loop, t, state, carry.mode, ticking)[1])
        seen = loop.observe(t, state, carry.mode, here._replace(signals=here.within))
        left = (course.begins < course.begins[:, -1:]).sum(-1) - self._period
        error = seen.reference.value - seen.output
        self.now = Moment(t, state.plant, error, seen, ~carry.alive, left)
        return self.now

    @property
    def over(self) -> Tensor:
        """Which episodes are at their horizon, (B,) bool."""
        begins = self._course.begins
        return begins[self._rows, self._period] >= begins[:, -1]

    def _conditions(self, k: Tensor) -> Conditions:
        """What steps k (B,) are under."""
        course, k = self._course, self._within(k)
        segment = course.segment[self._rows, k]
        if self._known is None or not torch.equal(segment, self._known[0]):
            rows = map_tensors(lambda x: x[self._rows, segment], course.parameters)
            self._known = segment, self._loop.plant.coefficients(rows)
        noise = None if course.noise is None else course.noise[self._rows, k]
        span = None
        if course.span is not None:
            span = Span(*(edge[self._rows, k] for edge in course.span))
        return Conditions(self._signals.aligned, self._known[1], noise, None, span)

    def _time(self, k: Tensor) -> Tensor:
        """At which steps k (B,) begin [s]."""
        times = self._course.times
        return times[self._rows, k.clamp(max=times.shape[1] - 1)]

    def _within(self, k: Tensor) -> Tensor:
        """Numbers of steps, at an episode's end of its last."""
        return k.clamp(max=self._course.segment.shape[1] - 1)
