"""The time grid of a rollout: uniform steps that end exactly on every parameter jump."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import FROM_0, POSITIVE, maybe, number
from ..errors import ConfigError

# Knots closer together than this [s] count as one: no solver can step between them.
MERGE = 1e-9
# More rows than this are a slip of the pen.
MAX_ROWS = 1e9


def shares_of(times: Tensor) -> Tensor:
    """Time that the error at each step time stands for (T+1,) [s]: the step after it."""
    sizes = times.diff()
    return torch.cat([sizes, sizes[-1:]])


def counted_in(times: Tensor, horizon: Tensor) -> Tensor:
    """Which step times lie within each sample's horizon (...,): (T+1, ...) bool."""
    return times.reshape(-1, *(1,) * horizon.dim()) <= horizon + MERGE


def _check_interval(name: str, value: float, end: float = 0.0) -> None:
    number(name, value, POSITIVE)
    if end > MAX_ROWS * value:
        raise ConfigError(f"{name} = {value}: over {MAX_ROWS:.0e} intervals in {end:g} s")


def _merged(starts: Tensor, instants: Tensor) -> Tensor:
    """Sorted times of both; of those within `MERGE` of each other, the one in `starts`."""
    instants = instants.sort().values
    apart = torch.ones_like(instants, dtype=torch.bool)
    apart[1:] = instants.diff() > MERGE  # 0.3 and 3 * 0.1 are one instant
    instants = instants[apart]
    place = torch.searchsorted(starts, instants)
    padded = torch.cat([starts.new_tensor([-torch.inf]), starts, starts.new_tensor([torch.inf])])
    gap = torch.minimum(instants - padded[place], padded[place + 1] - instants)
    return torch.cat([starts, instants[gap > MERGE]]).sort().values


@dataclass(frozen=True)
class Segment:
    """Steps over which all plant parameters are constant."""

    first: int  # index of the first step
    last: int  # index after the last step
    lookup: float  # time at which the parameters in force are read [s]


class Train(NamedTuple):
    """Instants offset + k period [s], k = 0, 1, ..."""

    period: float
    offset: float = 0.0

    def until(self, end: float) -> Tensor:
        """All of them before `end` [s]."""
        count = max(0, math.ceil((end - self.offset) / self.period))
        instants = self.offset + self.period * torch.arange(count, dtype=torch.float64)
        return instants[instants < end]


class StepGrid:
    """Times 0 = t_0 < ... < t_T = horizon, at most `dt` apart, with all knots, trains and jumps.

    Parameters jump at `knots`, which begin segments; signals do at `jumps`.

    Raises `ConfigError` unless dt and periods are finite and > 0.
    """

    def __init__(
        self,
        horizon: float,
        knots: Sequence[float],
        dt: float,
        trains: Sequence[Train] = (),
        jumps: Sequence[float] = (),
    ) -> None:
        _check_interval("dt", dt, horizon)
        edges: list[float] = [0.0]
        lookups: list[float] = [0.0]
        for knot in sorted(knots):
            if knot >= horizon - MERGE:
                break
            if knot - edges[-1] <= MERGE:
                lookups[-1] = knot
            else:
                edges.append(knot)
                lookups.append(knot)
        starts, self._instants = torch.tensor(edges, dtype=torch.float64), []
        for train in trains:
            _check_interval("period", train.period, horizon)
            instants = train.until(horizon - MERGE)
            starts = _merged(starts, instants)
            self._instants.append(instants)
        self.jumps = bool(jumps)
        if jumps:
            starts = _merged(starts, torch.tensor(jumps, dtype=torch.float64))
        ends = torch.cat([starts[1:], starts.new_tensor([horizon])])
        counts = torch.ceil((ends - starts) / dt - 1e-6).clamp(min=1).to(torch.int64)
        first = counts.cumsum(0) - counts
        place = torch.arange(int(counts.sum())) - first.repeat_interleave(counts)
        fraction = place.to(torch.float64) / counts.repeat_interleave(counts)
        start, length = (x.repeat_interleave(counts) for x in (starts, ends - starts))
        self.times = torch.cat([start + length * fraction, starts.new_tensor([horizon])])
        knots_at = torch.searchsorted(starts, torch.tensor(edges, dtype=torch.float64))
        cuts = first[knots_at].tolist()
        self.segments = [
            Segment(cut, last, lookup)
            for cut, last, lookup in zip(cuts, [*cuts[1:], len(place)], lookups, strict=True)
        ]

    def ticks(self, train: int) -> Tensor:
        """Whether a step begins at an instant of that train, (T,) bool."""
        instants, starts = self._instants[train], self.times[:-1]
        found = torch.zeros(len(starts), dtype=torch.bool)
        if len(instants):
            found[torch.searchsorted(starts, instants - MERGE)] = True
        return found

    @property
    def n_steps(self) -> int:
        """T."""
        return len(self.times) - 1

    def motion_rows(self, motion_dt: float | None) -> list[int]:
        """Indices of the grid times at or last before every multiple of `motion_dt` [s].

        All indices if it is None; the last one always.
        """
        if motion_dt is None:
            return list(range(self.n_steps + 1))
        end = float(self.times[-1])
        _check_interval("motion_dt", motion_dt, end)
        wanted = torch.arange(int(end / motion_dt + 1e-9) + 1, dtype=torch.float64) * motion_dt
        index = torch.searchsorted(self.times, wanted + MERGE, right=True) - 1
        return sorted({*index.tolist(), self.n_steps})

    def samples(self, sample_dt: float, until: float | None = None) -> list[int]:
        """Indices of the grid times at or next after every multiple of `sample_dt` [s].

        The last one is always included; `until` [s] ends the sampling early.
        """
        _check_interval("sample_dt", sample_dt, float(self.times[-1]))
        maybe("sample_until", until, FROM_0)
        end = float(self.times[-1]) if until is None else min(until, float(self.times[-1]))
        wanted = torch.arange(int(end / sample_dt + 1e-9) + 1, dtype=torch.float64) * sample_dt
        index = torch.searchsorted(self.times, wanted - MERGE).clamp(max=self.n_steps)
        found = sorted({int(i) for i in index.unique()})
        if until is None and found[-1] != self.n_steps:
            found.append(self.n_steps)
        return found
