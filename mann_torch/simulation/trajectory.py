"""The result of a rollout."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from torch import Tensor

from ..signals import Reference
from ..types import LoopState, Mode, ReferenceSample
from .events import EventCounts
from .task import Effort


class Status(IntEnum):
    """How a sample ended."""

    OK = 0
    DIVERGED = 1  # an entry of the state reached the divergence limit
    NOT_FINITE = 2  # an entry became NaN or inf, or the solver could not continue


@dataclass(frozen=True)
class Trajectory:
    """Joint motion at step times, the whole state at samples, and one status per sample.

    Rows of a sample after `stopped_at` repeat its last good state.
    """

    t: Tensor  # (T',) step times at which the motion is kept [s]; all of them unless `motion_dt`
    q: Tensor  # (T', ..., n) [rad]
    qd: Tensor  # (T', ..., n) [rad/s]
    squared_error: Tensor  # (T', ..., n) integral of e^2 over all steps up to t [rad^2 s]
    effort: Effort | None  # each (T', ..., n); None unless `effort_after` was given
    step_t: Tensor  # (T+1,) all step times [s]
    horizon: Tensor  # (...,) [s]
    sample_t: Tensor  # (K,) times of `states` and `modes` [s]
    states: LoopState  # (K, ..., *event)
    modes: Mode  # (K, ..., *event)
    final_mode: Mode  # (..., *event) at the end
    status: Tensor  # (...,) int64, values of `Status`
    stopped_at: Tensor  # (...,) [s], NaN where the sample ran to the end
    cause: Tensor  # (...,) int64, index in `leaf_names` of what failed first; -1 where nothing did
    leaf_names: tuple[str, ...]
    solver: str
    engine: str  # "fused", "compiled" or "eager"
    engine_reason: str  # why this engine was taken
    signal: Reference = field(repr=False)
    events: EventCounts | None = None  # met by a hybrid rollout, each (...,); else None

    @property
    def reference(self) -> ReferenceSample:
        """The desired trajectory at `t`, each member (T', ..., n)."""
        sample: ReferenceSample = self.signal(self.t)
        return sample

    @property
    def error(self) -> Tensor:
        """Tracking error e = s - x (T', ..., n) [rad]."""
        return self.reference.q - self.q

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
