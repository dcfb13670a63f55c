"""Scenarios of one configuration with random masses, a rollout each."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import cast

import numpy as np
import torch
from torch import Tensor

from mann_torch import Scenario
from mann_torch.plants.two_link_arm import ArmParameters
from mann_torch.signals import PiecewiseConstant

from ..settings.config import SimulateConfig
from .masses import mass_schedule

#: 64-bit numbers that one count of the generator yields.
_BLOCK = 4


def random_masses(
    masses: Sequence[float], spread: float, seed: int, first: int, count: int
) -> Tensor:
    """Rows first to first + count - 1 of (..., 2) [kg]: each mass times 1 +- spread, uniform.

    The generator counts, and rollout k is what it gives at k: its masses depend on seed and number
    alone.
    """
    raw = np.random.Philox(key=seed, counter=first).random_raw(_BLOCK * count)
    unit = (raw.reshape(count, _BLOCK)[:, : len(masses)] >> np.uint64(11)) * 2.0**-53
    factors = torch.from_numpy(1.0 + spread * (2.0 * unit - 1.0))
    return factors * torch.tensor(list(masses), dtype=torch.float64)


def with_masses(scenario: Scenario, cfg: SimulateConfig, masses: Tensor) -> Scenario:
    """The scenario of a configuration, unbatched, with masses (B, 2) at the start.

    Its schedule is computed by what computes one rollout's, all rollouts at once: the same bits.
    """
    times, values = mass_schedule(cfg.scenario, masses, scenario.end)
    at = torch.tensor(times, dtype=torch.float64).expand(len(masses), len(times))
    parameters = cast(ArmParameters, scenario.parameters)._replace(masses=masses)
    schedule = {**scenario.schedule, "masses": PiecewiseConstant(at, values)}
    return dataclasses.replace(scenario, parameters=parameters, schedule=schedule)
