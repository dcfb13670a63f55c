"""Constants judged on scenarios and draws they were not tuned on, beside others."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mann_torch import ClosedLoop
from mann_torch.errors import ConfigError
from mann_torch.tuning import Ensemble, Score

from ..building.controllers import paper_constants
from ..building.ensembles import check_names, scenarios_of, tuned_ensemble
from ..runs.intervals import Interval, interval
from ..settings.checks import holds_truth
from ..settings.machine import check_file
from ..settings.study_config import SetConfig, TuneConfig

MOST_POINTS = 100_000  # of a grid
START, TUNED = "start", "tuned"
#: What a candidate may cost beside the start, to count as within limits.
RATE_LIMIT, PEAK_LIMIT = 1.0, 1.1


@dataclass(frozen=True)
class Candidate:
    """Constants under a name; those not given are the scenario's own."""

    name: str
    values: Mapping[str, Tensor]


@dataclass(frozen=True)
class Verdict:
    """One scenario: paired changes from the start [%], over draws."""

    scenario: str
    candidate: str
    srmse: Interval
    rate: Interval
    peak: Interval

    @property
    def within_limits(self) -> bool:
        """No more input rate, at most a tenth more peak input."""
        return self.rate.mean <= 100 * (RATE_LIMIT - 1) and self.peak.mean <= 100 * (PEAK_LIMIT - 1)


def grid_candidates(grid: Any) -> list[Candidate]:
    """Every combination of the grid's values. Raises `ConfigError`."""
    if grid is None:
        return []
    if not isinstance(grid, Mapping):
        raise ConfigError(f"grid = {grid}: give lists of numbers by name, grid={{rate_W:[10,30]}}")
    columns = []
    for name, values in grid.items():
        try:
            if holds_truth(values):
                raise TypeError
            columns.append([float(value) for value in values])
        except (TypeError, ValueError):
            raise ConfigError(f"grid.{name} = {values}: give a list of numbers") from None
    points = math.prod(map(len, columns))
    if points > MOST_POINTS:
        raise ConfigError(f"grid has {points} points: at most {MOST_POINTS}")
    found = []
    for point in itertools.product(*columns) if columns else []:
        pairs = list(zip(grid, point, strict=True))
        values = {name: torch.tensor(value, dtype=torch.float64) for name, value in pairs}
        found.append(Candidate(", ".join(f"{name}={value:g}" for name, value in pairs), values))
    return found


def with_own(grid: Any, loop: ClosedLoop) -> Any:
    """A grid without constants of the paper's controller that a loop lacks."""
    if not isinstance(grid, Mapping):
        return grid
    there = loop.constants()
    return {k: v for k, v in grid.items() if k in there or k not in paper_constants()} or None


def constants_in(where: str, path: str) -> dict[str, Tensor]:
    """Constants of a run of `tune`: of its `constants.json`, or of its folder's.

    Raises `ConfigError`, which begins with `where`.
    """
    file = Path(path)
    file = file / "constants.json" if file.is_dir() else file
    check_file(f"{where}:", file)
    try:
        return {
            str(name): torch.tensor(value, dtype=torch.float64)
            for name, value in json.loads(file.read_text())["constants"].items()
        }
    except OSError as error:
        raise ConfigError(f"{where}: {file}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"{where}: {file}: {type(error).__name__}: {error}") from None


def compared(paths: Sequence[str]) -> list[Candidate]:
    """Constants of other runs, from their `constants.json`. Raises `ConfigError`."""
    found = []
    for path in paths:
        values = constants_in("compare", path)
        found.append(Candidate("tuned: " + ", ".join(values), values))
    return found


def held_out_ensembles(cfg: TuneConfig, of: SetConfig) -> dict[str, Ensemble]:
    """One ensemble a scenario: all its draws. Raises `ConfigError`."""
    check_names("held_out", of.scenarios, of.draws)
    names = scenarios_of(cfg, of)
    return {name: tuned_ensemble(cfg, [name], of.draws) for name in names}


def check_candidates(ensemble: Ensemble, candidates: Sequence[Candidate]) -> None:
    """Raise `ConfigError` for a constant that does not exist or can't have its value."""
    loop = ensemble.loop
    for candidate in candidates:
        for name, value in candidate.values.items():
            domain, event = loop.domain(name), loop.constant(name).shape
            domain.check(f"{candidate.name}: {name}", domain.coerce(value, event))


def evaluate(
    ensemble: Ensemble,
    candidates: Sequence[Candidate],
    progress: Callable[[int], object] | None = None,
) -> Score:
    """Scores (C, draws) of all candidates from one batch."""
    loop = ensemble.loop
    names = {name for candidate in candidates for name in candidate.values}
    values = {}
    for name in sorted(names):
        start = loop.constant(name).detach()
        domain = loop.domain(name)
        rows = [domain.coerce(c.values.get(name, start), start.shape) for c in candidates]
        values[name] = torch.stack(rows).unsqueeze(1)
    return ensemble.scores(values, progress)


def verdicts(
    scores: Mapping[str, Score], candidates: Sequence[Candidate], of: Sequence[str]
) -> list[Verdict]:
    """The named candidates against the first one, scenario by scenario."""
    names = [candidate.name for candidate in candidates]
    found = []
    for scenario, score in scores.items():
        for name in of:
            changes = [_change(leaf[names.index(name)].numpy(), leaf[0].numpy()) for leaf in score]
            found.append(Verdict(scenario, name, *changes))
    return found


def _change(new: np.ndarray, old: np.ndarray) -> Interval:
    return interval(100.0 * (new - old) / old.mean())


def markdown(found: Sequence[Verdict]) -> str:
    """A table: paired change from the start, mean and 95 % interval over draws."""
    lines = [
        "| scenario | constants | SRMSE | RMS input rate | peak input | within limits |",
        "|---|---|---|---|---|---|",
    ]
    for v in found:
        within = "yes" if v.within_limits else "no"
        lines.append(
            f"| {v.scenario} | {v.candidate} | {v.srmse} | {v.rate} | {v.peak} | {within} |"
        )
    return "\n".join(lines)


def rows(scores: Mapping[str, Score], candidates: Sequence[Candidate]) -> list[list[Any]]:
    """A line for every scenario, candidate and draw, header first."""
    table: list[list[Any]] = [["scenario", "constants", "draw", *Score._fields]]
    for scenario, score in scores.items():
        columns = [leaf.tolist() for leaf in score]
        for c, candidate in enumerate(candidates):
            for draw in range(len(columns[0][c])):
                table.append(
                    [scenario, candidate.name, draw, *(column[c][draw] for column in columns)]
                )
    return table
