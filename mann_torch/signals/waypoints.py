"""Motions through waypoints at given times."""

from __future__ import annotations

import torch
from torch import Tensor

from ..functional import Numbers
from ..types import ReferenceSample
from .pieces import begun, check_knots, row_at
from .powers import derivatives
from .reference import Reference
from .rows import spread


class Quintic(Reference):
    """Polynomials of degree 5 between waypoints: given positions, velocities and accelerations.

    `times` (..., K) [s] increase, K >= 2; `positions` are (..., K, p), `velocities` [1/s] and
    `accelerations` [1/s^2] broadcast to it. Before the first time and from the last on it holds
    still. All of them receive gradients. Raises `ConfigError`, `ShapeError`, `KindError` or
    `DtypeError`.
    """

    order = 4

    def __init__(
        self,
        times: Numbers,
        positions: Numbers,
        velocities: Numbers = 0.0,
        accelerations: Numbers = 0.0,
    ) -> None:
        super().__init__()
        self.times: Tensor
        self.positions: Tensor
        self.velocities: Tensor
        self.accelerations: Tensor
        times, positions = self.hold("times", times), self.hold("positions", positions, 2)
        check_knots(self._kind, times, "positions", positions)
        for name, rows in (("velocities", velocities), ("accelerations", accelerations)):
            self.hold(name, spread(f"{self._kind} {name}", rows, positions.shape[-2:]), 2)
        self.width = positions.shape[-1]
        self.share_batch()

    def at(self, t: Tensor) -> ReferenceSample:
        """Position and `order` derivatives."""
        last = self.times.shape[-1] - 1
        passed = begun(self.times, t)
        moving = ((passed > 0) & (passed <= last)).unsqueeze(-1)
        before = (passed - 1).clamp(min=0)
        after = (before + 1).clamp(max=last)
        times = self.times.unsqueeze(-1)
        start = row_at(times, before)
        # Guarded where it holds still: there position `before` is what counts.
        length = torch.where(moving, row_at(times, after) - start, 1.0)
        share = torch.where(moving, (t - start) / length, 0.0)
        ends = [
            (row_at(self.positions, k), row_at(self.velocities, k), row_at(self.accelerations, k))
            for k in (before, after)
        ]
        value, *rates = derivatives(_coefficients(ends[0], ends[1], length), share, self.order)
        found, unit = [value], length
        for rate in rates:
            found.append(torch.where(moving, rate / unit, 0.0))
            unit = unit * length
        return ReferenceSample(*found)


class MinimumJerk(Quintic):
    """From rest to rest through waypoints: x_k + (x_{k+1} - x_k) (10 s^3 - 15 s^4 + 6 s^5).

    s runs from 0 to 1 between two times: of all motions from rest to rest the one of the least
    integral of jerk^2 (Flash and Hogan 1985). Arguments and errors as of `Quintic`.
    """

    def __init__(self, times: Numbers, positions: Numbers) -> None:
        super().__init__(times, positions)


def _coefficients(
    start: tuple[Tensor, ...], end: tuple[Tensor, ...], length: Tensor
) -> tuple[Tensor, ...]:
    """Of the quintic, in time as a share of `length`, with these ends: six of (..., p)."""
    x, v, a = start[0], start[1] * length, start[2] * length * length
    way, v_end, a_end = end[0] - x, end[1] * length, end[2] * length * length
    return (
        x,
        v,
        0.5 * a,
        10.0 * way - 6.0 * v - 4.0 * v_end - 0.5 * (3.0 * a - a_end),
        -15.0 * way + 8.0 * v + 7.0 * v_end + 0.5 * (3.0 * a - 2.0 * a_end),
        6.0 * way - 3.0 * (v + v_end) - 0.5 * (a - a_end),
    )
