"""Mass schedules of scenarios, from their configuration."""

from __future__ import annotations

import math
import re
from typing import Any

from mann_torch.errors import ConfigError
from mann_torch.signals import growing_square, multiplied

from ..settings.config import ScenarioConfig

MAX_JUMPS = 100_000
_SQRT = re.compile(r"sqrt\(\s*([0-9.eE+-]+)\s*\)")


def mass_schedule(
    scenario: ScenarioConfig, masses: list[float], horizon: float
) -> tuple[list[float], list[list[float]]]:
    """Jump times [s] and mass rows [kg] of a scenario, up to its horizon."""
    if scenario.mass_growth is not None:
        if scenario.mass_jumps:
            raise ConfigError("scenario: give mass_jumps or mass_growth, not both")
        growth = scenario.mass_growth
        if not (growth.increment > 0 and growth.period > 0 and math.isfinite(growth.increment)):
            raise ConfigError("scenario.mass_growth: increment and period must be > 0")
        if horizon / growth.period > MAX_JUMPS:
            raise ConfigError(
                f"scenario.mass_growth.period = {growth.period}: over {MAX_JUMPS} jumps"
            )
        count = math.ceil(horizon / growth.period) - 1
        times = [growth.period * (n + 1) for n in range(count)]
        return times, growing_square(masses, growth.increment, count)
    times, factors = [], []
    for jump in scenario.mass_jumps:
        if not isinstance(jump, list | tuple) or len(jump) != 2:
            raise ConfigError(f"scenario.mass_jumps: '{jump}' is not [time, factor]")
        times.append(_number(jump[0], "time"))
        factors.append(_number(jump[1], "factor"))
    if any(factor <= 0 for factor in factors):
        raise ConfigError(f"scenario.mass_jumps: factors {factors} must be > 0")
    return times, multiplied(masses, factors)


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
        number = math.sqrt(float(match.group(1))) if match else float(value)
    except (TypeError, ValueError):
        raise ConfigError(
            f"scenario.mass_jumps: {what} '{value}' is neither a number nor sqrt(number)"
        ) from None
    if not math.isfinite(number):
        raise ConfigError(f"scenario.mass_jumps: {what} {value} must be finite")
    return number
