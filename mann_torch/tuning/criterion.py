"""What is minimised, in one's own words: a judge, and limits on what else it may cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import POSITIVE, flag, function, named, number
from ..errors import ConfigError
from ..simulation import Status, Trajectory
from .judges import Judge, Recording, recording_of, worth
from .limits import check_limit, check_weight, limited


@dataclass(frozen=True)
class Limit:
    """An upper bound on what a judge of one's own finds.

    In the judge's unit or, if `relative`, a multiple of what the member had at the start. Raises
    `ConfigError` unless it is > 0, `KindError`.
    """

    quantity: Judge
    bound: float
    relative: bool = False

    def __post_init__(self) -> None:
        function("limit quantity", self.quantity)
        number("limit bound", self.bound, POSITIVE)
        flag("limit relative", self.relative)


class Measured(NamedTuple):
    """What a criterion's judges found; NaN for a sample that diverged."""

    value: Tensor  # (..., B)
    quantities: Tensor  # (..., B, K), of its limits


@dataclass(frozen=True)
class Criterion:
    """value / value_0 + penalties, for each member: `Objective` with judges of one's own.

    0 stands for the constants one starts from; where a value of 0 or less is possible there, give
    a `scale` in its place. What exceeds a limit counts `penalty` times the square of its relative
    excess. The rollouts keep what the judges declare (`Judged`): everything, if they declare
    nothing. A sample that diverged counts as in `Objective`, and so does one that a judge finds
    NaN.

    Raises `ConfigError` for a penalty < 0 or a scale that is not > 0, `KindError`.
    """

    value: Judge
    limits: Mapping[str, Limit] = field(default_factory=dict)
    penalty: float = 20.0
    scale: float | None = None

    def __post_init__(self) -> None:
        function("criterion value", self.value)
        named("criterion limits", self.limits, Limit)
        check_weight("criterion penalty", self.penalty)
        check_limit("criterion scale", self.scale)

    @property
    def recording(self) -> Recording:
        """What rollouts must keep for all judges."""
        return recording_of(self.value, *(limit.quantity for limit in self.limits.values()))

    def measure(self, trajectory: Trajectory) -> Measured:
        """What the judges find."""
        ok = trajectory.status == int(Status.OK)
        judges = [self.value, *(limit.quantity for limit in self.limits.values())]
        found = [torch.where(ok, worth(judge, trajectory), torch.nan) for judge in judges]
        return Measured(found[0], torch.stack(found, dim=-1)[..., 1:])

    def __call__(self, measured: Measured, start: Measured) -> Tensor:
        """(..., B) from what was measured (..., B) and what at the start (B,).

        Raises `ConfigError` where something is relative to a start that is not > 0.
        """
        ok = torch.isfinite(measured.value) & torch.isfinite(measured.quantities).all(dim=-1)
        value = torch.where(ok, measured.value, start.value)
        quantities = torch.where(ok.unsqueeze(-1), measured.quantities, start.quantities)
        if self.scale is None:
            total = value / _positive(start.value, "the criterion's value", "scale")
        else:
            total = value / self.scale
        limits = []
        columns = zip(quantities.unbind(-1), start.quantities.unbind(-1), strict=True)
        for (name, limit), (quantity, first) in zip(self.limits.items(), columns, strict=True):
            if limit.relative:
                quantity = quantity / _positive(first, f"relative limit '{name}'", "bound")
            limits.append((quantity, limit.bound))
        return limited(total, limits, self.penalty, ok)


def _positive(start: Tensor, what: str, instead: str) -> Tensor:
    if not bool((start > 0).all()):
        raise ConfigError(f"{what}: not > 0 at the start for every member; give a {instead} of it")
    return start
