"""Signals of a rollout, recomputed from its saved states."""

from __future__ import annotations

import torch
from torch import Tensor

from ..checks import instance
from ..signals import noise_at
from ..trees import leaves
from ..types import MemoryMode
from .closed_loop import ClosedLoop, Observation
from .conditions import Conditions
from .scenario import Scenario
from .starting import coefficients_of
from .trajectory import Trajectory


def observe(loop: ClosedLoop, scenario: Scenario, trajectory: Trajectory) -> Observation:
    """Inputs, outputs, reference, signals at the trajectory's samples, each (K, ..., .).

    Raises `KindError`.
    """
    instance("loop", loop, ClosedLoop)
    instance("scenario", scenario, Scenario)
    instance("trajectory", trajectory, Trajectory)
    plant, t = trajectory.states.plant, trajectory.sample_t
    batch = leaves(plant)[0].shape[1:-1]
    coefficients = coefficients_of(loop, scenario, batch, t)
    noise = None
    if scenario.noise is not None:
        # At the end of the last step no other begins: it shows the noise of the last.
        step = torch.searchsorted(trajectory.step_t, t)
        instants = scenario.noise.instants(trajectory.step_t[:-1])
        chosen = instants[step.clamp(max=len(instants) - 1)]
        widths = [part.shape[-1] for part in loop.plant.measure(plant, coefficients)]
        table = scenario.noise.expand(batch).table(widths, int(instants[-1]) + 1)
        noise = noise_at(table, chosen)
    outside = scenario.surroundings.expand(batch)
    here = Conditions(outside, coefficients, noise)
    return loop.observe(t, trajectory.states, trajectory.held, here)


def attended_slot(trajectory: Trajectory) -> Tensor | None:
    """Slot attended at each sample (K, ...); None without a memory.

    A mode saved at a sample was decided at the start of the step before it. Raises `KindError`.
    """
    modes = instance("trajectory", trajectory, Trajectory).modes
    return modes.attended if isinstance(modes, MemoryMode) else None
