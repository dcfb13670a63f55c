"""Slopes of an objective along coordinates, by differences: `differences` and `smoothed`.

`values(z)` is the objective of B members at z (C, B, P): (C, B). Each slope comes for every member,
so that an interval over members says how far it can be trusted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..checks import WITHIN_2, choice, function, instance, number, whole
from ..errors import ConfigError
from ..statistics import mean_and_half, student_factor

DESIGNS = ("each", "joint")


#: The objective of every member (C, B) at coordinates z (C, B, P).
Values = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Slope:
    """The slope of the members' mean along each coordinate, with its 95 % interval."""

    mean: Tensor  # (P,)
    half: Tensor  # (P,) half-width; NaN where it can't be told
    value: float  # the objective, mean over everything that was computed
    members: Tensor | None = None  # (B, P), where each member has a slope of its own

    @property
    def silent(self) -> Tensor:
        """Coordinates without a signal (P,): a slope of exactly 0, or an interval around 0."""
        return (self.mean == 0) | ~(self.mean.abs() > self.half.nan_to_num(nan=0.0))

    @staticmethod
    def of_members(slopes: Tensor, value: float) -> Slope:
        """From a slope a member, (B, P)."""
        mean, half = mean_and_half(slopes)
        return Slope(mean, half, value, slopes)


def differences(values: Values, z: Tensor, members: int, step: float) -> Slope:
    """Central differences of each coordinate at z (P,): the judge of all other modes.

    Exact to O(step^2) where the objective is smooth; across its jumps, the mean slope over
    z - step to z + step. Costs 2 P rollouts a member. Raises `ConfigError`, `KindError`.
    """
    _check(values, z, members)
    step = number("step", step, WITHIN_2)
    offsets = step * torch.eye(len(z), dtype=z.dtype)
    up, down = _antithetic(values, z, offsets.unsqueeze(1).expand(-1, members, -1))
    return Slope.of_members(((up - down) / (2.0 * step)).mT, _mean(up, down))


def smoothed(
    values: Values,
    z: Tensor,
    members: int,
    *,
    spread: float = 0.126,
    pairs: int = 3,
    design: str = "each",
    generator: torch.Generator | None = None,
    control: Tensor | None = None,
) -> Slope:
    """The slope of the objective averaged over z - spread to z + spread (and over members).

    It is the slope of a straight line fitted to the objective where z is scattered evenly over
    +- `spread`: that of the objective smoothed by Epanechnikov's kernel, of the same width as a
    difference over +- 0.77 `spread`. With an odd number of pairs and no generator, the middle one
    is a difference over +- 0.79 `spread`: +- 10 % by default. Jumps from branch to branch are part
    of it, as they are for whoever changes a constant by that much. Copies come in pairs z + d,
    z - d; the sizes |d| divide the kernel into strata of equal weight, at their middles or, with a
    `generator`, anywhere in them.

    ``each`` moves one coordinate at a time: 2 P `pairs` rollouts a member, an interval over
    members. ``joint`` moves all at once with random signs: 2 `pairs` rollouts a member, whatever P;
    the slopes are fitted to all members' pairs together, and the interval is that of the fit. It
    needs members * pairs > P and a generator.

    `control` (B, P) holds exact slopes (by `plain`) of coordinates along which those are right, NaN
    for the others: a control variate. ``joint`` takes out what they predict before the fit and puts
    it back after it, which spares the others their noise. ``each`` uses that the difference of the
    two slopes should be 0 on average: as much of it is taken off as least variance over the members
    asks for, unless its interval excludes 0, since then `plain` is not right.

    Raises `ConfigError`, `KindError`.
    """
    _check(values, z, members)
    spread, pairs = number("spread", spread, WITHIN_2), whole("pairs", pairs)
    choice("design", design, DESIGNS)
    if generator is not None:
        instance("generator", generator, torch.Generator)
    if control is not None:
        instance("control", control, Tensor)
    if design == "each":
        return _each(values, z, members, spread, pairs, generator, control)
    if generator is None or members * pairs <= len(z):
        raise ConfigError(
            f"design 'joint': give a generator, and more pairs: {members} members x {pairs} pairs "
            f"can't tell {len(z)} coordinates apart"
        )
    return _joint(values, z, members, spread, pairs, generator, control)


def _check(values: Values, z: Tensor, members: int) -> None:
    function("values", values)
    instance("z", z, Tensor)
    whole("members", members)


def _sizes(shape: tuple[int, ...], spread: float, generator: torch.Generator | None) -> Tensor:
    """Sizes of moves (K, ...), one a stratum of density 3 u^2 on (0, 1), times spread."""
    strata = torch.arange(shape[0], dtype=torch.float64).reshape(-1, *(1,) * (len(shape) - 1))
    inside = torch.full(shape, 0.5, dtype=torch.float64)
    if generator is not None:
        inside = torch.rand(shape, generator=generator, dtype=torch.float64)
    return spread * ((strata + inside) / shape[0]) ** (1.0 / 3.0)


def _each(
    values: Values,
    z: Tensor,
    members: int,
    spread: float,
    pairs: int,
    generator: torch.Generator | None,
    control: Tensor | None,
) -> Slope:
    P = len(z)
    sizes = _sizes((pairs, P, members), spread, generator)
    eye = torch.eye(P, dtype=z.dtype)
    offsets = (sizes.unsqueeze(-1) * eye[:, None, :]).flatten(0, 1)
    up, down = _antithetic(values, z, offsets)
    slopes = ((up - down) / (2.0 * sizes.flatten(0, 1))).unflatten(0, (pairs, P)).mean(dim=0)
    found = slopes.mT
    if control is not None:
        found = _controlled(found, control)
    return Slope.of_members(found, _mean(up, down))


def _controlled(slopes: Tensor, control: Tensor) -> Tensor:
    """Slopes (B, P) less as much of their difference from `control` as gives least variance."""
    apart = slopes - control
    mean, half = mean_and_half(apart)
    centred = apart - mean
    share = (centred * (slopes - slopes.mean(dim=0))).sum(dim=0) / centred.square().sum(dim=0)
    trusted = (mean.abs() <= half) & torch.isfinite(share)  # NaN compares as False
    taken = torch.where(trusted, share.clamp(0.0, 1.0), 0.0) * torch.where(trusted, apart, 0.0)
    return slopes - taken


def _joint(
    values: Values,
    z: Tensor,
    members: int,
    spread: float,
    pairs: int,
    generator: torch.Generator,
    control: Tensor | None,
) -> Slope:
    P = len(z)
    sizes = _sizes((pairs, members, P), spread, generator)
    signs = _signs(pairs * members, P, generator).reshape(pairs, members, P)
    offsets = sizes * signs
    up, down = _antithetic(values, z, offsets)
    rise = 0.5 * (up - down)
    known = torch.zeros(members, P, dtype=z.dtype)
    if control is not None:
        known = control.nan_to_num(nan=0.0)
        rise = rise - (offsets * known).sum(dim=-1)
    rows, target = offsets.reshape(-1, P), rise.reshape(-1)
    inverse = torch.linalg.inv(rows.mT @ rows)
    slope = inverse @ (rows.mT @ target)
    degrees = len(rows) - P
    rest = target - rows @ slope
    error = (rest.square().sum() / degrees * inverse.diagonal()).sqrt()
    half = student_factor(degrees) * error
    mean, own = mean_and_half(known) if control is not None else (slope * 0, slope * 0)
    return Slope(slope + mean, (half.square() + own.nan_to_num().square()).sqrt(), _mean(up, down))


def _signs(rows: int, columns: int, generator: torch.Generator) -> Tensor:
    """Signs (rows, columns) of a Hadamard design, columns orthogonal over whole blocks of rows."""
    size = 1
    H = torch.ones(1, 1, dtype=torch.float64)
    while size < columns:
        H = torch.cat([torch.cat([H, H], dim=1), torch.cat([H, -H], dim=1)])
        size *= 2
    columns_taken = torch.randperm(size, generator=generator)[:columns]
    blocks = [
        H[torch.randperm(size, generator=generator)][:, columns_taken]
        for _ in range(-(-rows // size))
    ]
    return torch.cat(blocks)[:rows]


def _antithetic(values: Values, z: Tensor, offsets: Tensor) -> tuple[Tensor, Tensor]:
    """Objective at z + offsets and z - offsets (K, B, P): each (K, B), from one batch."""
    up, down = values(z + torch.cat([offsets, -offsets])).chunk(2)
    return up, down


def _mean(up: Tensor, down: Tensor) -> float:
    return float(0.5 * (up.mean() + down.mean()))
