"""Episodes laid out for stepping: one of them, and a batch in which each is at its own time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..errors import ConfigError, ShapeError
from ..signals import Surroundings, noise_at
from ..simulation import ClosedLoop, Scenario, Solver
from ..simulation.conditions import Span, spans_of
from ..simulation.task import grid_of, task_of
from ..trees import leaves, map_tensors, structure
from ..types import LoopMode, LoopState


class Course(NamedTuple):
    """What an episode's T steps are under; a batch has (B, ...) of each, padded at the end."""

    times: Tensor  # (T + 1,) [s]; padding repeats the last
    segment: Tensor  # (T,) int64, of the parameters in force
    parameters: Any  # (S, d) a field, of the plant's
    noise: Tensor | None  # (T, Y) on what is measured
    sampled: Tensor  # (T,) bool, whether the sensor ticks
    begins: Tensor  # (P + 1,) int64, first step of each period, and T
    span: Span | None  # each (T,), where signals jump


class Episode(NamedTuple):
    """An episode before it begins."""

    course: Course
    state: LoopState
    mode: LoopMode
    surroundings: Surroundings


def episode_of(loop: ClosedLoop, scenario: Scenario, solver: Solver) -> Episode:
    """One episode: its steps are those of a rollout of the same scenario.

    Raises `ShapeError` for a scenario with batch dimensions, and what `rollout` raises.
    """
    if scenario.batch_shape != ():
        raise ShapeError(
            f"scenario has batch shape {tuple(scenario.batch_shape)}: an episode is one task; a "
            "function that draws one gives each environment its own"
        )
    task = task_of(loop, scenario, solver, grid_of(loop, scenario, solver.dt))
    grid, count = task.grid, task.grid.n_steps
    segment = torch.zeros(count, dtype=torch.int64)
    for number, part in enumerate(grid.segments):
        segment[part.first : part.last] = number
    lookups = torch.tensor([part.lookup for part in grid.segments], dtype=torch.float64)
    parameters = map_tensors(
        lambda rows: rows.detach().expand(len(lookups), rows.shape[-1]),
        scenario.parameters_at(lookups),
    )
    noise = None if task.noise is None else noise_at(task.noise, task.noise_instants)
    if task.ticks is None:
        raise ConfigError("a loop that is stepped from outside needs a clock")
    sampled, ticks = task.ticks
    begins = torch.cat([ticks.nonzero()[:, 0], torch.tensor([count])])
    course = Course(grid.times, segment, parameters, noise, sampled, begins, task.spans)
    return Episode(course, task.state, task.mode, scenario.surroundings)


def signals_of(episodes: Sequence[Episode]) -> Surroundings:
    """Of a batch (B, ...). Raises `ConfigError` for those that do not stack."""
    signals = [episode.surroundings for episode in episodes]
    if all(each is signals[0] for each in signals):
        return signals[0].expand((len(signals),))
    return signals[0].stack(signals)


def course_of(episodes: Sequence[Episode]) -> Course:
    """Of a batch (B, ...); if all are one and the same it is not written out.

    Raises `ConfigError` for episodes that do not go together.
    """
    first, count = episodes[0], len(episodes)
    if all(episode is first for episode in episodes):
        wide: Course = map_tensors(lambda x: x.expand(count, *x.shape), first.course)
        return wide
    kinds = {
        (e.course.noise is None, e.surroundings.disturbance is None, type(e.course.parameters))
        for e in episodes
    }
    if len(kinds) != 1:
        raise ConfigError(
            "scenarios of environments side by side: all with noise, or none; all with a "
            "disturbance, or none; all of one plant's parameters"
        )
    courses = [episode.course for episode in episodes]
    if any(course.span is not None for course in courses):
        courses = [c._replace(span=c.span or spans_of(c.times)) for c in courses]
    batch: Course = map_tensors(lambda *rows: _stacked(rows), *courses)
    return batch


def rewritten(course: Course, places: Sequence[int], episodes: Sequence[Episode]) -> bool:
    """Put other episodes' courses in their places (B, ...), if they fit there: whether they do."""
    rows = [leaves(episode.course) for episode in episodes]
    whole = leaves(course)
    if len(whole[0]) == 1 or whole[0].stride(0) == 0:  # an episode's own, not written out
        return False
    if any(structure(episode.course) != structure(course) for episode in episodes):
        return False
    if any(len(row) > x.shape[1] for new in rows for x, row in zip(whole, new, strict=True)):
        return False
    for place, new in zip(places, rows, strict=True):
        for x, row in zip(whole, new, strict=True):
            x[place] = _padded(row, x.shape[1])
    return True


def _padded(row: Tensor, longest: int) -> Tensor:
    """(T_i, ...) -> (T, ...): a shorter one repeats its last row."""
    if len(row) == longest:
        return row
    return row[torch.arange(longest).clamp(max=len(row) - 1)]


def _stacked(rows: Sequence[Tensor]) -> Tensor:
    """(T_i, ...) -> (B, T, ...)."""
    longest = max(len(row) for row in rows)
    return torch.stack([_padded(row, longest) for row in rows])


def put(whole: Any, places: Sequence[int], rows: Sequence[Any]) -> Any:
    """A tree (B, ...) with other rows (...) at some places."""
    index = torch.tensor(list(places))
    return map_tensors(lambda old, *new: old.index_copy(0, index, torch.stack(new)), whole, *rows)
