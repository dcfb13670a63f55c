"""The result of a rollout."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from torch import Tensor

from ..types import LoopState, Mode, ReferenceSample


class Status(IntEnum):
    """How a sample ended."""

    OK = 0
    DIVERGED = 1  # the state left the finite range, or the solver could not continue


@dataclass(frozen=True)
class Trajectory:
    """Joint motion at every step, the whole state at samples, and one status per sample.

    Rows of a sample after `stopped_at` repeat its last good state.
    """

    t: Tensor  # (T+1,) step times [s]
    q: Tensor  # (T+1, ..., n) [rad]
    qd: Tensor  # (T+1, ..., n) [rad/s]
    reference: ReferenceSample  # (T+1, ..., n)
    horizon: Tensor  # (...,) [s]
    sample_t: Tensor  # (K,) times of `states` and `modes` [s]
    states: LoopState  # (K, ..., *event)
    modes: Mode  # (K, ..., *event)
    final_mode: Mode  # (..., *event) at the end
    status: Tensor  # (...,) int64, values of `Status`
    stopped_at: Tensor  # (...,) [s], NaN where the sample ran to the end
    solver: str
    engine: str  # "eager" or "compiled"

    @property
    def error(self) -> Tensor:
        """Tracking error e = s - x (T+1, ..., n) [rad]."""
        return self.reference.q - self.q

    def describe_status(self) -> list[str]:
        """One phrase per sample of the flattened batch."""
        phrases = []
        for code, time in zip(
            self.status.reshape(-1).tolist(), self.stopped_at.reshape(-1).tolist(), strict=True
        ):
            name = Status(code).name.lower()
            phrases.append(name if code == Status.OK else f"{name} at t = {time:.6g} s")
        return phrases
