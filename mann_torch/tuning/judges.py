"""Judges: what a rollout is worth, and what rollouts must keep for a judge to tell."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..checks import FROM_0, POSITIVE, flag, function, instance, maybe, number
from ..errors import ConfigError, ShapeError
from ..simulation import Outcome, Trajectory

#: What a rollout is worth, (..., B). It is given everything, unless it has a `recording`.
Judge = Callable[[Trajectory], Tensor]


@dataclass(frozen=True)
class Recording:
    """What rollouts keep for a judge: the options of `rollout`, everything if not given.

    A judge that declares `totals_only` is given an `Outcome`, one with `sample_until` = 0 a
    `Motion`: what is not kept is refused, not made up. Numbers are the same whatever is kept; what
    it costs is memory.

    Raises `ConfigError` for `totals_only` beside anything to keep or an interval that is not > 0,
    `KindError`.
    """

    motion_dt: float | None = None  # [s] between instants of motion; None: every step
    sample_dt: float = 0.05  # [s] between whole states
    sample_until: float | None = None  # [s]; None: to the end, 0: no whole states
    totals_only: bool = False  # what `srmse`, `input_rate`, `peak_input` and counts read

    def __post_init__(self) -> None:
        maybe("motion_dt", self.motion_dt, POSITIVE)
        number("sample_dt", self.sample_dt, POSITIVE)
        maybe("sample_until", self.sample_until, FROM_0)
        if flag("totals_only", self.totals_only) and (
            self.motion_dt is not None or self.sample_until is not None
        ):
            raise ConfigError("totals_only keeps no motion and no states: leave out the others")

    def shown(self, trajectory: Trajectory) -> Outcome:
        """The part of a rollout that was asked for."""
        if self.totals_only:
            return trajectory.outcome
        return trajectory.motion if self.sample_until == 0.0 else trajectory


EVERYTHING = Recording()
#: Motion at every step, no whole states.
MOTION = Recording(sample_until=0.0)
TOTALS = Recording(totals_only=True)


@dataclass(frozen=True)
class Judged:
    """A judge that declares what it reads. (So does any callable with a `recording` of its own.)

    Raises `KindError`.
    """

    judge: Callable[..., Tensor]
    recording: Recording

    def __post_init__(self) -> None:
        function("judge", self.judge)
        instance("recording", self.recording, Recording)

    def __call__(self, trajectory: Trajectory) -> Tensor:
        """What a rollout is worth, (..., B)."""
        return self.judge(trajectory)


def recording_of(*judges: Judge) -> Recording:
    """What all of these judges ask for together; of one that declares nothing, everything."""
    for judge in judges:
        function("judge", judge)
    declared: Iterable[Recording] = (getattr(j, "recording", EVERYTHING) for j in judges)
    asked = {recording for recording in declared if not recording.totals_only}
    if len(asked) <= 1:
        return asked.pop() if asked else TOTALS
    steps = {recording.motion_dt for recording in asked}
    untils = [recording.sample_until for recording in asked]
    return Recording(
        motion_dt=steps.pop() if len(steps) == 1 else None,
        sample_dt=min(recording.sample_dt for recording in asked),
        sample_until=None if None in untils else max(u for u in untils if u is not None),
    )


def worth(judge: Judge, trajectory: Trajectory) -> Tensor:
    """`judge` of a rollout, one number a sample (..., B).

    Raises `ShapeError` where it gives anything else.
    """
    found, batch = judge(trajectory), tuple(trajectory.status.shape)
    if not isinstance(found, Tensor) or tuple(found.shape) != batch:
        given = tuple(found.shape) if isinstance(found, Tensor) else type(found).__name__
        raise ShapeError(f"a judge gives one number a rollout, {batch}; this one gave {given}")
    return found.to(torch.float64)
