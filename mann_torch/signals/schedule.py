"""Piecewise-constant plant parameters, each sample with its own jump times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ..checks import number, several, whole
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64
from .pieces import begun, row_at
from .rows import Rows


class PiecewiseConstant(Rows):
    """Value `values[..., k, :]` from `times[..., k-1]` (included) to `times[..., k]` (excluded).

    `times` (..., K) [s] increase and are > 0; inf pads a sample with fewer jumps. `values`
    (..., K + 1, d) may require grad. Raises `ConfigError`, `KindError`, `DtypeError` or
    `ShapeError`; a rollout checks again what was changed since.
    """

    def __init__(self, times: Numbers, values: Numbers) -> None:
        super().__init__()
        self.times: Tensor
        self.values: Tensor
        self.hold("times", as_float64(times, "schedule times").detach(), finite=False)
        self.hold("values", values, 2, finite=False)
        self.check()

    @property
    def _kind(self) -> str:
        return "schedule"

    def form(self) -> Any:
        """Numbers of jumps may differ: `stack` pads."""
        return type(self), self.batch_shape, self.values.shape[-1]

    def check(self, name: str = "schedule") -> None:
        """Raise, as on making, for times and values that do not fit (any more)."""
        for what, tensor in self.held().items():
            as_float64(tensor, f"{name} {what}")
        if self.values.dim() != self.times.dim() + 1 or (
            self.values.shape[:-1] != (*self.times.shape[:-1], self.times.shape[-1] + 1)
        ):
            raise ShapeError(
                f"{name} of times {tuple(self.times.shape)} and values "
                f"{tuple(self.values.shape)}: one value row more than times is needed"
            )
        finite = torch.where(torch.isinf(self.times), torch.finfo(torch.float64).max, self.times)
        order = torch.diff(finite, dim=-1)
        padded = torch.isinf(self.times)[..., 1:]
        if bool((torch.isnan(self.times) | (self.times <= 0)).any()) or bool(
            ((order <= 0) & ~padded).any()
        ):
            raise ConfigError(f"{name} times {self.times.tolist()}: must increase from > 0")

    def knots(self) -> list[float]:
        """All jump times of all samples, sorted, each once [s]."""
        finite = self.times[torch.isfinite(self.times)]
        return sorted(set(finite.reshape(-1).tolist()))

    def at(self, t: Tensor) -> Tensor:
        """Values in force at times t [s]: (*t.shape, ..., d)."""
        return self.in_force(t.reshape(t.shape + (1,) * self.times.dim()))

    def in_force(self, t: Tensor) -> Tensor:
        """Values in force (..., d) at times t (..., 1) [s] that broadcast with the batch shape."""
        return row_at(self.values, begun(self.times, t))

    @staticmethod
    def stack(
        schedules: Sequence[PiecewiseConstant],
    ) -> PiecewiseConstant:
        """One schedule with a new leading batch dimension; shorter ones are padded.

        Raises `KindError`, or `ConfigError` for none, or where batch shapes or widths differ.
        """
        schedules = several("schedules", schedules, PiecewiseConstant)
        if len({schedule.form()[1:] for schedule in schedules}) != 1:
            raise ConfigError("schedules to stack: at least one, of one batch shape and one width")
        longest = max(schedule.times.shape[-1] for schedule in schedules)
        times, values = [], []
        for schedule in schedules:
            missing = longest - schedule.times.shape[-1]
            pad = schedule.times.new_full((*schedule.batch_shape, missing), torch.inf)
            times.append(torch.cat([schedule.times, pad], dim=-1))
            last = schedule.values[..., -1:, :]
            values.append(torch.cat([schedule.values] + [last] * missing, dim=-2))
        return PiecewiseConstant(torch.stack(times), torch.stack(values))


def growing_square(initial: Numbers, increment: float, jumps: int) -> Tensor:
    """Rows m(n) = m(0) sqrt(1 + increment n): the paper's m^2 -> m^2 + increment m(0)^2.

    (..., jumps + 1, d) from `initial` (..., d). Raises `KindError` or `ShapeError`, and
    `ConfigError` where a mass would not stay >= 0.
    """
    start, jumps = _rows("initial", initial), whole("jumps", jumps, least=0)
    if 1.0 + number("increment", increment) * jumps < 0:
        raise ConfigError(f"increment = {increment}: after {jumps} jumps nothing is left")
    roots = [(1.0 + increment * n) ** 0.5 for n in range(jumps + 1)]
    return start.unsqueeze(-2) * torch.tensor(roots, dtype=torch.float64).unsqueeze(-1)


def _rows(name: str, numbers: Numbers) -> Tensor:
    rows = as_float64(numbers, name)
    if rows.dim() < 1:
        raise ShapeError(f"{name} has shape {tuple(rows.shape)}: give a row of numbers")
    return rows
