"""What a rollout asks of an engine, and what an engine gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..signals import Reference
from ..types import LoopState, Mode
from .closed_loop import ClosedLoop
from .events import EventCounts
from .scenario import Scenario
from .solver import Solver
from .step_grid import StepGrid


@dataclass(frozen=True)
class Task:
    """A checked rollout: every part has the batch shape `...`."""

    loop: ClosedLoop
    scenario: Scenario
    solver: Solver
    grid: StepGrid
    reference: Reference
    state: LoopState  # at t = 0
    mode: Mode
    horizon: Tensor  # (...,) [s]
    motion_rows: list[int]  # step times at which joint motion is kept
    state_rows: list[int]  # step times at which whole states are kept
    limit: float
    progress: Callable[[int], object] | None
    device: str
    tape_memory: float  # [bytes]
    hybrid: bool = False  # steps locate events, see `events.hybrid_step`

    @property
    def batch(self) -> torch.Size:
        """Batch shape `...`."""
        return self.state.plant.q.shape[:-1]


@dataclass(frozen=True)
class Record:
    """What an engine kept. Where every sample failed, rows after the last failure are missing."""

    motion: Tensor  # (T', ..., 2n) q and qd
    squared_error: Tensor  # (T', ..., n) running sum of squared error times its share of time
    states: LoopState  # (K, ..., *event)
    modes: Mode  # (K, ..., *event)
    final_mode: Mode
    stopped: Tensor  # (...,) int64, step that failed; -1 where none did
    kind: Tensor  # (...,) int64, values of `Status`
    leaf: Tensor  # (...,) int64, first leaf of the state that failed; -1 where none did
    engine: str
    reason: str  # why this engine
    events: EventCounts | None = None  # each (...,); None in plain rollouts
