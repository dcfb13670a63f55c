"""Mass schedules of scenarios, from their configuration."""

from __future__ import annotations

import math
import re
from typing import Any

import torch
from torch import Tensor

from mann_torch.errors import ConfigError
from mann_torch.functional import Numbers
from mann_torch.signals import growing_square, multiplied

from ..settings.config import MassGrowthConfig, ScenarioConfig

MAX_JUMPS = 100_000
LEAST_MASS, MOST_MASS = 1e-100, 1e100  # [kg]
_SQRT = re.compile(r"sqrt\(\s*([0-9.eE+-]+)\s*\)")


def mass_schedule(
    scenario: ScenarioConfig, masses: Numbers, horizon: float
) -> tuple[list[float], Tensor]:
    """Jump times [s] of a scenario up to its horizon, and masses (..., K + 1, 2) [kg] before,
    between and after them, from those at the start (..., 2).
    """
    growth = scenario.mass_growth or MassGrowthConfig()
    increment, period = growth.increment, growth.period
    if increment is not None or period is not None:
        if scenario.mass_jumps:
            raise ConfigError("scenario: give mass_jumps or mass_growth, not both")
        if increment is None or period is None or not (increment > 0 and period > 0):
            raise ConfigError("scenario.mass_growth: give increment and period, both > 0")
        if not horizon / period <= MAX_JUMPS:
            raise ConfigError(f"scenario.mass_growth.period = {period}: over {MAX_JUMPS} jumps")
        count = math.ceil(horizon / period) - 1
        times = [period * (n + 1) for n in range(count)]
        return times, _possible(times, growing_square(masses, increment, count), "mass_growth")
    times, factors = [], []
    for jump in scenario.mass_jumps:
        if not isinstance(jump, list | tuple) or len(jump) != 2:
            raise ConfigError(f"scenario.mass_jumps: '{jump}' is not [time, factor]")
        times.append(_number(jump[0], "time"))
        factors.append(_number(jump[1], "factor"))
    if any(factor <= 0 for factor in factors):
        raise ConfigError(f"scenario.mass_jumps: factors {factors} must be > 0")
    return times, _possible(times, multiplied(masses, factors), "mass_jumps")


def _possible(times: list[float], rows: Tensor, where: str) -> Tensor:
    """The rows, if the plant can compute with every one: it multiplies masses by each other."""
    later = rows[..., 1:, :]
    bad = torch.nonzero(~((later >= LEAST_MASS) & (later <= MOST_MASS)))
    if len(bad):
        place = tuple(bad[0].tolist())
        raise ConfigError(
            f"scenario.{where}: from {times[place[-2]]:g} s on a mass is {float(later[place]):g} "
            f"kg; {LEAST_MASS:g} to {MOST_MASS:g} kg can be computed with"
        )
    return rows


def late_jumps(scenario: ScenarioConfig, horizon: float | None) -> str | None:
    """What to say of mass jumps that never happen: they lie at the horizon [s] or beyond."""
    end = scenario.horizon if horizon is None else horizon
    times = [_number(jump[0], "time") for jump in scenario.mass_jumps]
    late = [time for time in times if time >= end]
    if not late:
        return None
    return (
        f"{len(late)} of {len(times)} mass jumps, the first at {late[0]:g} s, come after the "
        f"horizon of {end:g} s and never happen"
    )


def _number(value: Any, what: str) -> float:
    match = _SQRT.fullmatch(value.strip()) if isinstance(value, str) else None
    try:
        if isinstance(value, bool):
            raise TypeError
        number = math.sqrt(float(match.group(1))) if match else float(value)
    except (TypeError, ValueError):
        raise ConfigError(
            f"scenario.mass_jumps: {what} '{value}' is neither a number nor sqrt(number)"
        ) from None
    if not math.isfinite(number):
        raise ConfigError(f"scenario.mass_jumps: {what} {value} must be finite")
    return number
