"""The result of a rollout: what it came to, the plant's motion, whole states."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import TYPE_CHECKING, Any, TypeVar

import torch
from torch import Tensor

from ..errors import RecordError
from ..signals import Reference
from ..trees import map_tensors
from ..types import Channel, LoopMode, LoopState, Mode, ReferenceSample, Snapshot
from .events.steps import EventCounts
from .step_grid import counted_in
from .task import Effort


class Status(IntEnum):
    """How a sample ended."""

    OK = 0
    DIVERGED = 1  # an entry of the state reached the divergence limit
    NOT_FINITE = 2  # an entry became NaN or inf, or the solver could not continue


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a rollout came to: totals over all its steps, and one status per sample.

    All that the metrics read, unless they leave out a beginning. What only a `Motion` or a
    `Trajectory` has is refused with a `RecordError`.
    """

    #: (T', ..., p) integral of e^2 over all steps up to t; of an outcome alone T' = 1.
    squared_error: Tensor
    effort: Effort | None  # each (T', ..., m); None unless `effort_after` was given
    inputs: tuple[Channel, ...]  # names and units of the m inputs
    outputs: tuple[Channel, ...]  # and of the p outputs
    step_t: Tensor  # (T+1,) all step times [s]
    horizon: Tensor  # (...,) [s]
    final_mode: Mode  # (..., *event) of the controller at the end
    status: Tensor  # (...,) int64, values of `Status`
    stopped_at: Tensor  # (...,) [s], NaN where the sample ran to the end
    cause: Tensor  # (...,) int64, index in `leaf_names` of what failed first; -1 where nothing did
    leaf_names: tuple[str, ...]
    solver: str
    engine: str  # "compiled"; of the torch engine "eager" or "torch.compile"
    engine_reason: str  # why this engine was taken
    events: EventCounts | None = None  # met by a hybrid rollout, each (...,); else None

    def describe_status(self) -> list[str]:
        """One phrase per sample of the flattened batch."""
        phrases = []
        columns = (self.status, self.stopped_at, self.cause)
        for code, time, leaf in zip(*(c.reshape(-1).tolist() for c in columns), strict=True):
            if code == Status.OK:
                phrases.append("ok")
                continue
            name = self.leaf_names[leaf]
            what = f"{name} too large" if code == Status.DIVERGED else f"{name} not finite"
            phrases.append(f"diverged at t = {time:.6g} s: {what}")
        return phrases

    if not TYPE_CHECKING:  # a type checker knows what is not there

        def __getattr__(self, name: str) -> Tensor:
            """A field of the plant's state by its name, `q` of an arm; else, what is missing."""
            plant = self.__dict__.get("plant")
            if name in getattr(plant, "_fields", ()):
                return getattr(plant, name)
            for kind, what in ((Motion, "motion_dt"), (Trajectory, "sample_until")):
                known = name in vars(kind) or name in kind.__dataclass_fields__
                known = known or (kind is Motion and name in self.__dict__.get("leaf_names", ()))
                if known and not isinstance(self, kind):
                    raise RecordError(
                        f"'{name}' was not kept: a judge that reads it declares {what}, as in "
                        f"Judged(judge, Recording({what}=...)), or nothing at all"
                    )
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")


@dataclass(frozen=True, kw_only=True)
class Motion(Outcome):
    """An outcome with the plant's motion at step times.

    Rows of a sample after `stopped_at` repeat its last good state.
    """

    t: Tensor  # (T',) step times at which the motion is kept [s]; all of them unless `motion_dt`
    plant: Any  # state of the plant, a field (T', ..., d)
    output: Tensor  # (T', ..., p) what is to follow the reference
    followed: Tensor | None  # (T', ..., p) what a reference model gave; None without one
    signal: Reference = field(repr=False)

    @property
    def complete(self) -> bool:
        """Whether the motion is kept at every step time (up to where the last sample failed)."""
        return torch.equal(self.t, self.step_t[: len(self.t)])

    @property
    def within(self) -> Tensor:
        """Which rows count: those up to each sample's horizon, (T', ...) bool."""
        return counted_in(self.t, self.horizon)

    @property
    def reference(self) -> ReferenceSample:
        """The desired outputs at `t`, each member (T', ..., p), or a reference model's, if any.

        Raises `RecordError` where nothing was kept between the ends: two instants are no course.
        """
        if len(self.t) <= 2 and not self.complete:
            raise RecordError(
                f"the motion was kept at {len(self.t)} of {len(self.step_t)} instants: the course "
                "of the error needs a shorter motion_dt, or none"
            )
        sample: ReferenceSample = self.signal(self.t)
        if self.followed is not None:
            return ReferenceSample(self.followed, command=sample.value)
        return sample

    @property
    def error(self) -> Tensor:
        """Tracking error e = s - y (T', ..., p). Raises what `reference` raises."""
        return self.reference.value - self.output

    @property
    def outcome(self) -> Outcome:
        """Without the motion: of everything that runs over the steps, the end."""
        found = _as(Outcome, self)
        sums, effort = map_tensors(_last, found.squared_error), map_tensors(_last, found.effort)
        return replace(found, squared_error=sums, effort=effort)


@dataclass(frozen=True, kw_only=True)
class Trajectory(Motion):
    """What a rollout came to, the motion at step times and the whole state at samples."""

    sample_t: Tensor  # (K,) times of `states`, `modes` and `held` [s]
    states: LoopState  # (K, ..., *event)
    modes: Mode  # (K, ..., *event) of the controller
    held: LoopMode = field(repr=False)  # (K, ..., *event) those with what sensor and clock hold

    @property
    def end(self) -> Snapshot:
        """Where it ended (..., *event), for another rollout to `begin` at, with time 0 there.

        Raises `RecordError` where that was not kept.
        """
        last = self.step_t[-1]
        if self.sample_t[-1] != last:
            raise RecordError(
                f"states are kept until t = {float(self.sample_t[-1]):.6g} s, not to the end: "
                "leave out `sample_until`, and see `status`"
            )
        found = map_tensors(lambda rows: rows[-1], Snapshot(self.states, self.held))
        clock = found.mode.clock
        if clock is None or clock.at is None:
            return found
        return found._replace(mode=found.mode._replace(clock=clock._replace(at=clock.at - last)))

    @property
    def motion(self) -> Motion:
        """Without the whole states."""
        return _as(Motion, self)


Kind = TypeVar("Kind", bound=Outcome)


def _as(kind: type[Kind], whole: Outcome) -> Kind:
    return kind(**{each.name: getattr(whole, each.name) for each in fields(kind)})


def _last(rows: Tensor) -> Tensor:
    return rows[-1:]
