"""Experiments of one loop side by side in one batch."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from mann_torch import MeasurementNoise, Scenario
from mann_torch.errors import ConfigError
from mann_torch.plants import Plant
from mann_torch.signals import PiecewiseConstant
from mann_torch.trees import map_tensors

from .build import Experiment


def side_by_side(
    parts: Sequence[Experiment], draws: int
) -> tuple[Scenario, Any, dict[str, Tensor]]:
    """Scenarios (B,), initial weights (B, *event), and the constants that differ, (B, *event).

    Each part is a scenario with its draws; B counts all draws of all parts in order. Raises
    `ConfigError` where they can't be in one batch.
    """
    plant = parts[0].loop.plant
    scenarios = alike(plant, [part.alone or part.scenario for part in parts])
    weights = None
    if parts[0].weights is not None:
        weights = map_tensors(lambda *leaf: torch.cat(leaf), *(part.weights for part in parts))
    constants = [part.loop.constants() for part in parts]
    own = {}
    for name in constants[0]:
        column = [constant[name].detach() for constant in constants]
        if any(not torch.equal(value, column[0]) for value in column):
            own[name] = torch.cat([value.expand(draws, *value.shape) for value in column])
    every = Scenario.stack([scenario for scenario in scenarios for _ in range(draws)])
    noises = [part.scenario.noise for part in parts if part.scenario.noise is not None]
    if noises:
        every = dataclasses.replace(every, noise=_in_a_row(noises))
    return every, weights, own


def alike(plant: Plant, scenarios: Sequence[Scenario]) -> list[Scenario]:
    """The same scenarios, each with a start and with a schedule of all that any of them moves.

    Raises `ConfigError` where one disturbs and another does not.
    """
    moved = dict.fromkeys(name for scenario in scenarios for name in scenario.schedule)
    if len({scenario.disturbance is None for scenario in scenarios}) > 1:
        raise ConfigError("scenarios of one batch: all with a disturbance, or none")
    found = []
    for scenario in scenarios:
        schedule = dict(scenario.schedule)
        for name in (name for name in moved if name not in schedule):
            rows = getattr(scenario.parameters, name)
            times = rows.new_zeros((*rows.shape[:-1], 0))
            schedule[name] = PiecewiseConstant(times, rows.unsqueeze(-2))
        start = plant.rest() if scenario.start is None else scenario.start
        found.append(dataclasses.replace(scenario, schedule=schedule, start=start))
    return found


def _in_a_row(noises: Sequence[MeasurementNoise]) -> MeasurementNoise:
    """Noises (draws,) of one rate as one."""
    std, seed = (torch.cat([getattr(n, name) for n in noises]) for name in ("std", "seed"))
    return MeasurementNoise(std, seed, noises[0].rate)
