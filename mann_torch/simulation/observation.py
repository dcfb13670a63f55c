"""Signals of a rollout, recomputed from its saved states."""

from __future__ import annotations

from torch import Tensor

from ..types import ControlOutput, MemoryMode
from .closed_loop import ClosedLoop
from .scenario import Scenario
from .trajectory import Trajectory


def observe(loop: ClosedLoop, scenario: Scenario, trajectory: Trajectory) -> ControlOutput:
    """Torque, errors, features, read and weights at the trajectory's samples, each (K, ..., .)."""
    batch = trajectory.states.plant.q.shape[1:-1]
    reference = scenario.reference.expand(batch)
    return loop.observe(trajectory.sample_t, trajectory.states, trajectory.modes, reference)


def attended_slot(trajectory: Trajectory) -> Tensor | None:
    """Slot attended at each sample (K, ...); None without a memory.

    A mode saved at a sample was decided at the start of the step before it.
    """
    modes = trajectory.modes
    return modes.attended if isinstance(modes, MemoryMode) else None
