"""Scenarios of one configuration with random parameters of the plant, a rollout each."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mann_torch import Scenario
from mann_torch.errors import ConfigError
from mann_torch.plants import Plant

from ..settings.config import ScenarioConfig
from .made import mapping, unknown
from .schedules import schedules

#: 64-bit numbers that one count of the generator yields.
_BLOCK = 4


def spreads(node: Any, plant: Plant) -> dict[str, float]:
    """Spread of each parameter that has one, in the plant's order. Raises `ConfigError`."""
    given = {name: value for name, value in mapping("spread", node).items() if value is not None}
    for name, value in given.items():
        if name not in plant.fields:
            hint = f"the plant, unless spread.{name}=null"
            raise unknown("spread", name, hint, plant.fields)
        told = f"spread.{name} = {value}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigError(f"{told}: give a number, or null for none")
        if not (math.isfinite(value) and 0 <= value < 1):
            raise ConfigError(f"{told}: must be >= 0 and < 1")
    return {name: float(given[name]) for name in plant.fields if name in given}


def random_rows(
    rows: Mapping[str, Tensor], spread: Mapping[str, float], seed: int, first: int, count: int
) -> dict[str, Tensor]:
    """Rows first to first + count - 1 of each (..., d): each number times 1 +- spread, uniform.

    The generator counts, and rollout k is what it gives at k: its numbers depend on seed, number
    and what is spread alone.
    """
    widths = [rows[name].shape[-1] for name in spread]
    blocks = max(1, -(-sum(widths) // _BLOCK))
    raw = np.random.Philox(key=seed, counter=first * blocks).random_raw(_BLOCK * blocks * count)
    unit = (raw.reshape(count, _BLOCK * blocks) >> np.uint64(11)) * 2.0**-53
    found, start = {}, 0
    for (name, size), width in zip(spread.items(), widths, strict=True):
        own = unit[:, start : start + width]
        found[name] = torch.from_numpy(1.0 + size * (2.0 * own - 1.0)) * rows[name]
        start += width
    return found


def with_rows(
    scenario: Scenario, cfg: ScenarioConfig, plant: Plant, rows: Mapping[str, Tensor]
) -> Scenario:
    """The scenario of a configuration with parameters (B, d) of its own at the start.

    Its schedules are computed by what computes one rollout's, all rollouts at once: the same bits.
    """
    parameters = scenario.parameters._replace(**rows)
    plant.check(parameters)
    schedule = schedules(cfg, plant, parameters, scenario.end)
    return dataclasses.replace(scenario, parameters=parameters, schedule=schedule)
