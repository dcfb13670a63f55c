"""Settings that were typed and that nothing of what was chosen uses.

No list says who uses what: a setting is used if what would run is another with other numbers in
its place, or without it. Where that can't be told it counts as used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import FunctionType, MethodType
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf
from torch import Tensor

from mann_torch.errors import ConfigError

from .overrides import as_typed

#: What a configuration's settings lead to; None where they do not tell.
WhatRuns = Callable[[Any], object]
#: Told apart from others by name alone, and of a part that there may not be.
_GROUPS = ("keys",)
#: Which of many, as `seed` is; what no loop shows, and solvers refuse by themselves.
_ANYWAY = ("initial.draw", "solver")
#: x becomes a x + b.
_OTHER_NUMBERS = ((1, 1), (2, 1), (0.5, 0))


@dataclass
class Typed:
    """Jobs of a command line, each its overrides, and what they compose to."""

    jobs: Sequence[Sequence[str]]
    configurations: Sequence[Any]
    compose: Callable[[list[str]], Any]
    what_runs: WhatRuns
    _known: dict[int, object] = field(default_factory=dict)

    def check_used(self, judged: Sequence[str]) -> None:
        """Raise `ConfigError` for one within the nodes `judged` that no job has a use for.

        In a sweep one job that uses it is enough: the others are there to be compared.
        """
        for key in dict.fromkeys(key_of(o) for job in self.jobs for o in job):
            if key in _ANYWAY or not (key in _GROUPS or "." in key):
                continue
            if key.partition(".")[0] not in judged or key.partition(".")[0] in _ANYWAY:
                continue
            mine = [n for n, job in enumerate(self.jobs) if key in map(key_of, job)]
            if not any(self._uses(number, key) for number in mine):
                (text, *_) = (o for o in self.jobs[mine[0]] if key_of(o) == key)
                which = "the run" if len(self.jobs) == 1 else "every job"
                raise ConfigError(
                    f"{as_typed(text).lstrip('+~')}: nothing that is chosen here uses {key}; "
                    f"{which} would be the same without it"
                )

    def _uses(self, number: int, key: str) -> bool:
        if number not in self._known:
            self._known[number] = self.what_runs(self.configurations[number])
        mine, told = self._known[number], False
        if mine is None:
            return True
        for other in self._others(number, key):
            try:
                alike = same(mine, self.what_runs(other))
            except Exception:
                continue
            if not alike:
                return True
            told = True
        return not told

    def _others(self, number: int, key: str) -> Iterator[Any]:
        """The job's configuration with other numbers there; without any, as it is by itself."""
        cfg = self.configurations[number]
        given = OmegaConf.select(cfg, key)
        plain = OmegaConf.to_container(given) if OmegaConf.is_config(given) else given
        if changed(plain, 1, 1) != plain:
            for value in (changed(plain, *how) for how in _OTHER_NUMBERS):
                other = cfg.copy()
                OmegaConf.update(other, key, value, merge=False)
                if value != plain:
                    yield other
            return
        other = self.compose([o for o in self.jobs[number] if key_of(o) != key])
        if OmegaConf.select(other, key) != given:
            yield other


def key_of(override: str) -> str:
    """The setting that an override names."""
    return override.lstrip("+~").partition("=")[0].partition("@")[0]


def changed(value: Any, factor: float, more: float) -> Any:
    """The same with other numbers and truth values, whole ones where they were."""
    if isinstance(value, Mapping):
        return {key: changed(inner, factor, more) for key, inner in value.items()}
    if isinstance(value, list):
        return [changed(inner, factor, more) for inner in value]
    if isinstance(value, bool):
        return not value
    return type(value)(factor * value + more) if isinstance(value, int | float) else value


def same(one: Any, other: Any, seen: set[tuple[int, int]] | None = None) -> bool:
    """Whether two things are made alike, part by part; False where that can't be told."""
    seen = set() if seen is None else seen
    if one is other or (id(one), id(other)) in seen:
        return True
    if type(one) is not type(other):
        return False
    seen.add((id(one), id(other)))
    if isinstance(one, Tensor):
        return torch.equal(one, other)
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, Mapping):
        return list(one) == list(other) and all(same(one[key], other[key], seen) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(
            same(a, b, seen) for a, b in zip(one, other, strict=True)
        )
    if isinstance(one, MethodType):
        return same((one.__func__, one.__self__), (other.__func__, other.__self__), seen)
    if isinstance(one, FunctionType):
        cells = ([cell.cell_contents for cell in f.__closure__ or ()] for f in (one, other))
        return one.__code__ is other.__code__ and same(next(cells), next(cells), seen)
    return same(vars(one), vars(other), seen) if hasattr(one, "__dict__") else bool(one == other)
