"""Schedules of a plant's parameters, from changes told by name."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from mann_torch.errors import ConfigError
from mann_torch.functional import Numbers, as_float64
from mann_torch.plants import Plant
from mann_torch.signals import PiecewiseConstant, growing_square

from ..settings.config import ScenarioConfig
from .made import mapping, unknown

MAX_JUMPS = 100_000
#: A plant multiplies its parameters by each other: beyond these nothing can be computed.
LEAST, MOST = 1e-100, 1e100
HOW = ("factor", "add", "value")
_SQRT = re.compile(r"sqrt\(\s*([0-9.eE+-]+)\s*\)")


def schedules(
    scenario: ScenarioConfig, plant: Plant, parameters: Any, horizon: float
) -> dict[str, PiecewiseConstant]:
    """Of every parameter that the scenario moves, from its rows (..., d) at the start.

    Raises `ConfigError`; a parameter without changes has none.
    """
    found = {}
    for name, changes in _changes(scenario).items():
        where = f"scenario.schedule.{name}"
        if name not in plant.fields:
            raise unknown("scenario.schedule", name, _fits(scenario, plant), plant.fields)
        rows = getattr(parameters, name)
        times, values = schedule(where, changes, rows, horizon)
        at = torch.tensor(times, dtype=torch.float64).expand(*rows.shape[:-1], len(times))
        found[name] = PiecewiseConstant(at, values)
        try:
            plant.check(parameters._replace(**{name: values}))
        except ConfigError as error:
            raise type(error)(f"{where}: {error}") from None
    return found


def _fits(scenario: ScenarioConfig, plant: Plant) -> str:
    return f"scenario '{scenario.name}' is for another plant: choose scenario=plain, or of this one"


def _changes(scenario: ScenarioConfig) -> dict[str, list[Any]]:
    found = mapping("scenario.schedule", scenario.schedule)
    for name, changes in found.items():
        if changes is not None and not isinstance(changes, list):
            raise ConfigError(
                f"scenario.schedule.{name} = {changes}: give a list of [time, factor]"
            )
    return {name: changes for name, changes in found.items() if changes}


def schedule(
    where: str, changes: list[Any], start: Numbers, horizon: float
) -> tuple[list[float], Tensor]:
    """Times [s] of the changes, and rows (..., K + 1, d) before, between and after them.

    A change is [time, factor]; or {at: time, factor: ...}, {at: time, add: ...} or
    {at: time, value: ...}, of the whole row or with `entry: k`, from 1, of a number in it. What is
    given is a number or one a number of the row. {every: period, growth: increment} alone is
    m^2 -> m^2 + increment m(0)^2 every period. Raises `ConfigError`.
    """
    rows = as_float64(start, where)
    if any(isinstance(change, Mapping) and "every" in change for change in changes):
        times, values = _growing(where, changes, rows, horizon)
    else:
        if len(changes) > MAX_JUMPS:
            raise ConfigError(f"{where}: over {MAX_JUMPS} changes")
        times, each = [], [rows]
        for change in changes:
            time, how, number, entry = _told(where, change)
            times.append(time)
            each.append(_changed(where, each[-1], how, number, entry))
        values = torch.stack(each, dim=-2)
    _check_possible(where, times, values)
    return times, values


def _growing(
    where: str, changes: list[Any], rows: Tensor, horizon: float
) -> tuple[list[float], Tensor]:
    first = changes[0]
    if len(changes) > 1 or set(first) != {"every", "growth"}:
        raise ConfigError(f"{where}: give growth alone, as [{{every: period, growth: increment}}]")
    period, increment = (_number(where, first[name], name) for name in ("every", "growth"))
    if not (period > 0 and increment > 0):
        raise ConfigError(f"{where}: every and growth must be > 0")
    if not horizon / period <= MAX_JUMPS:
        raise ConfigError(f"{where}: every = {period}: over {MAX_JUMPS} changes")
    count = max(0, math.ceil(horizon / period) - 1)
    return [period * (n + 1) for n in range(count)], growing_square(rows, increment, count)


def _told(where: str, change: Any) -> tuple[float, str, Any, int | None]:
    """Time, how, what, and of which entry."""
    if isinstance(change, list) and len(change) == 2:
        change = {"at": change[0], "factor": change[1]}
    elif not isinstance(change, Mapping):
        raise ConfigError(f"{where}: '{change}' is not [time, factor]")
    how = [name for name in HOW if name in change]
    if "at" not in change or len(how) != 1 or set(change) - {"at", "entry", *how}:
        raise ConfigError(
            f"{where}: '{change}' is not [time, factor], nor at, one of {', '.join(HOW)}, and entry"
        )
    entry = change.get("entry")
    if entry is not None and (not isinstance(entry, int) or isinstance(entry, bool)):
        raise ConfigError(f"{where}: entry {entry} is no number of an entry, from 1")
    return _number(where, change["at"], "time"), how[0], change[how[0]], entry


def _changed(where: str, row: Tensor, how: str, given: Any, entry: int | None) -> Tensor:
    width = row.shape[-1]
    several = isinstance(given, list)
    numbers = [_number(where, one, how) for one in (given if several else [given])]
    if several and (entry is not None or len(numbers) != width):
        raise ConfigError(f"{where}: {how} {given}: give a number, or {width} and no entry")
    if entry is not None and not 1 <= entry <= width:
        raise ConfigError(f"{where}: entry {entry}: must be 1 to {width}")
    what = torch.tensor(numbers, dtype=torch.float64)
    new = {"factor": what * row, "add": what + row, "value": what.expand(row.shape)}[how]
    if entry is None:
        return new
    chosen = torch.arange(width) == entry - 1
    return torch.where(chosen, new, row)


def _check_possible(where: str, times: list[float], rows: Tensor) -> None:
    """Raise `ConfigError` for rows that no plant can compute with."""
    later = rows[..., 1:, :].abs()
    bad = torch.nonzero(~((later == 0) | ((later >= LEAST) & (later <= MOST))))
    if len(bad):
        place = tuple(bad[0].tolist())
        raise ConfigError(
            f"{where}: from {times[place[-2]]:g} s on one is {float(rows[..., 1:, :][place]):g}; "
            f"{LEAST:g} to {MOST:g} can be computed with"
        )


def late_changes(scenario: ScenarioConfig, horizon: float | None) -> str | None:
    """What to say of changes that never happen: they lie at the horizon [s] or beyond."""
    end = scenario.horizon if horizon is None else horizon
    times = [
        _told(name, change)[0]
        for name, changes in _changes(scenario).items()
        for change in changes
        if not (isinstance(change, Mapping) and "every" in change)
    ]
    late = [time for time in times if time >= end]
    if not late:
        return None
    return (
        f"{len(late)} of {len(times)} changes of parameters, the first at {min(late):g} s, come "
        f"after the horizon of {end:g} s and never happen"
    )


def _number(where: str, value: Any, what: str) -> float:
    match = _SQRT.fullmatch(value.strip()) if isinstance(value, str) else None
    try:
        if isinstance(value, bool):
            raise TypeError
        number = math.sqrt(float(match.group(1))) if match else float(value)
    except (TypeError, ValueError):
        raise ConfigError(
            f"{where}: {what} '{value}' is neither a number nor sqrt(number)"
        ) from None
    if not math.isfinite(number):
        raise ConfigError(f"{where}: {what} {value} must be finite")
    return number
