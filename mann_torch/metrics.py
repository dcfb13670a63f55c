"""Figures of merit of a trajectory."""

from __future__ import annotations

import torch
from torch import Tensor

from .simulation import Status, Trajectory


def srmse(trajectory: Trajectory, after: float | None = None) -> Tensor:
    """Sample root mean square error per joint, (..., n) [rad].

    The mean over the step times up to each sample's horizon, or, with `after` [s], over those
    later than that. Steps of unequal length count by their length. NaN for a sample that
    diverged, or whose horizon is not later than `after`. The paper's tables print 10^3 times this.
    """
    t, horizon = trajectory.t, trajectory.horizon
    steps = torch.diff(t)
    weights = torch.cat([steps, steps[-1:]])
    column = t.reshape(-1, *(1,) * horizon.dim())
    counted = column <= horizon + 1e-9
    if after is not None:
        counted = counted & (column > after)
    weights = weights.reshape(column.shape) * counted
    length = weights.sum(dim=0).unsqueeze(-1)
    ok = (trajectory.status == int(Status.OK)).unsqueeze(-1) & (length > 0)
    total = (weights.unsqueeze(-1) * trajectory.error.square()).sum(dim=0)
    mean = total / torch.where(ok, length, 1.0)
    return torch.where(ok, torch.where(ok, mean, 1.0).sqrt(), torch.nan)


def reallocations(trajectory: Trajectory) -> Tensor:
    """Number of slot resets, (...,) int64; 0 without a memory."""
    return _count(trajectory, "reallocations")


def switches(trajectory: Trajectory) -> Tensor:
    """Number of times the attended slot changed from step to step, (...,) int64."""
    return _count(trajectory, "switches")


def _count(trajectory: Trajectory, name: str) -> Tensor:
    if trajectory.final_mode is None:
        return torch.zeros_like(trajectory.status)
    count: Tensor = getattr(trajectory.final_mode, name)
    return count
