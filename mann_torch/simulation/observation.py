"""Signals of a rollout, recomputed from its saved states."""

from __future__ import annotations

import torch
from torch import Tensor

from ..checks import instance
from ..signals import noise_at
from ..types import ControlOutput, MemoryMode
from .closed_loop import ClosedLoop
from .scenario import Scenario
from .trajectory import Trajectory


def observe(loop: ClosedLoop, scenario: Scenario, trajectory: Trajectory) -> ControlOutput:
    """Torque, errors, features, read and weights at the trajectory's samples, each (K, ..., .).

    Raises `KindError`.
    """
    instance("loop", loop, ClosedLoop)
    instance("scenario", scenario, Scenario)
    instance("trajectory", trajectory, Trajectory)
    batch = trajectory.states.plant.q.shape[1:-1]
    reference = scenario.reference.expand(batch)
    noise = None
    if scenario.noise is not None:
        # At the end of the last step no other begins: it shows the noise of the last.
        step = torch.searchsorted(trajectory.step_t, trajectory.sample_t)
        instants = scenario.noise.instants(trajectory.step_t[:-1])
        chosen = instants[step.clamp(max=len(instants) - 1)]
        table = scenario.noise.expand(batch).table(reference.n_joints, int(instants[-1]) + 1)
        noise = noise_at(table, chosen)
    return loop.observe(trajectory.sample_t, trajectory.states, trajectory.modes, reference, noise)


def attended_slot(trajectory: Trajectory) -> Tensor | None:
    """Slot attended at each sample (K, ...); None without a memory.

    A mode saved at a sample was decided at the start of the step before it. Raises `KindError`.
    """
    modes = instance("trajectory", trajectory, Trajectory).modes
    return modes.attended if isinstance(modes, MemoryMode) else None
