"""Figures of merit of a trajectory."""

from __future__ import annotations

import torch
from torch import Tensor

from .checks import instance, maybe
from .errors import RecordError
from .simulation import Effort, Motion, Outcome, Status
from .simulation.step_grid import MERGE, counted_in, shares_of


def srmse(trajectory: Outcome, after: float | None = None) -> Tensor:
    """Sample root mean square error per output, (..., p), in its unit.

    The mean over all step times up to each sample's horizon, whatever part of the motion was kept,
    or, with `after` [s], over those later than that. Steps of unequal length count by their
    length. NaN for a sample that diverged, or whose horizon is not later than `after`. The paper's
    tables print 10^3 times this. With `motion_dt`, an error after `after` of less than 1e-7 of the
    whole is lost in rounding.

    Raises `RecordError` where no motion was kept at `after`, `KindError`.
    """
    instance("trajectory", trajectory, Outcome)
    after = maybe("after", after)
    step_t, horizon = trajectory.step_t, trajectory.horizon
    total, shares = trajectory.squared_error[-1], shares_of(step_t)
    if after is not None:
        later = step_t > after + MERGE
        shares = shares * later
        motion = _motion(trajectory)
        if motion.complete:
            # All motion is kept: no difference of integrals, which would lose a small late error.
            column = shares.reshape(-1, *(1,) * horizon.dim())
            weights = (column * counted_in(step_t, horizon))[: len(motion.t)].unsqueeze(-1)
            total = (weights * motion.error.square()).sum(dim=0)
        else:
            until = _integral_until(motion, int((~later).sum()) - 1)
            total = (total - until).clamp(min=0.0)
    length = _length(shares, step_t, horizon)
    return _root_mean(total, length, (trajectory.status == int(Status.OK)) & (length > 0))


def _length(shares: Tensor, step_t: Tensor, horizon: Tensor) -> Tensor:
    """Sum of the shares (T+1,) of time within each sample's horizon, (...,) [s].

    One sum a horizon, not one a sample: memory for every step of each sample is more than a rollout
    without motion needs itself, and rows of their own are summed alike in any batch.
    """
    ends, place = torch.unique(horizon, return_inverse=True)
    counted = counted_in(step_t, ends).mT.contiguous()
    return (shares * counted).sum(dim=-1)[place]


def _motion(trajectory: Outcome) -> Motion:
    if not isinstance(trajectory, Motion):
        raise RecordError("no motion was kept at `after`: declare a motion_dt that divides it")
    return trajectory


def _integral_until(trajectory: Motion, step: int) -> Tensor:
    """The integral of squared error up to a step, (..., p)."""
    if step < 0:
        return torch.zeros_like(trajectory.squared_error[-1])
    time = trajectory.step_t[step]
    row = int(torch.searchsorted(trajectory.t, time))
    if row >= len(trajectory.t):  # everything failed before
        return trajectory.squared_error[-1]
    if trajectory.t[row] != time:
        raise RecordError(
            f"no motion was kept at t = {float(time):.6g} s: take a motion_dt that divides `after`"
        )
    return trajectory.squared_error[row]


def input_rate(trajectory: Outcome) -> Tensor:
    """Root mean square rate of each commanded input, (..., m), its unit per s.

    What changes in it from one step's start to the next, over the step between: what noise
    on the measurements costs an actuator. NaN for a sample that diverged. Raises `RecordError`
    where the rollout was not asked for effort.
    """
    effort = _effort(trajectory)
    starts, horizon = trajectory.step_t[:-1], trajectory.horizon
    inside = counted_in(trajectory.step_t[1:], horizon)
    span = torch.where(inside, starts.reshape(-1, *(1,) * horizon.dim()), 0.0).amax(dim=0)
    ok = (trajectory.status == int(Status.OK)) & (span > 0)
    return _root_mean(effort.rate_square[-1], span, ok)


def peak_input(trajectory: Outcome) -> Tensor:
    """Largest |input| commanded since the rollout's `effort_after`, (..., m), in its unit.

    0 for a sample whose horizon ends before it, NaN for one that diverged. Raises `RecordError`
    where the rollout was not asked for effort.
    """
    peak = _effort(trajectory).peak[-1]
    return torch.where((trajectory.status == int(Status.OK)).unsqueeze(-1), peak, torch.nan)


def _effort(trajectory: Outcome) -> Effort:
    effort = instance("trajectory", trajectory, Outcome).effort
    if effort is None:
        raise RecordError("effort was not measured: give rollout an `effort_after`")
    return effort


def _root_mean(total: Tensor, length: Tensor, ok: Tensor) -> Tensor:
    """sqrt(total (..., p) / length (...,)); NaN where not ok, and slope 0 at 0."""
    ok = ok.unsqueeze(-1)
    mean = total / torch.where(ok, length.unsqueeze(-1), 1.0)
    moved = ok & (mean > 0)
    root = torch.where(moved, torch.where(moved, mean, 1.0).sqrt(), 0.0)
    return torch.where(ok, root, torch.nan)


def reallocations(trajectory: Outcome) -> Tensor:
    """Number of slot resets, (...,) int64; 0 of a controller without slots."""
    return _count(trajectory, "reallocations")


def switches(trajectory: Outcome) -> Tensor:
    """Number of times the attended slot changed from step to step, (...,) int64."""
    return _count(trajectory, "switches")


def _count(trajectory: Outcome, name: str) -> Tensor:
    mode = instance("trajectory", trajectory, Outcome).final_mode
    count: Tensor = getattr(mode, name, torch.zeros_like(trajectory.status))
    return count
