"""Elasticities d ln(mean SRMSE) / d ln(constant) by every gradient mode, and their worth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from mann_torch import Implicit, Outcome, reallocations, srmse, switches
from mann_torch.tuning import (
    PATHWISE,
    TOTALS,
    Coordinates,
    Ensemble,
    Judged,
    Slope,
    control_of,
    differences,
    pathwise_slopes,
    smoothed,
)
from mann_torch.types import Channel

from ..runs.intervals import Interval
from ..settings.study_config import GradientReportConfig


@dataclass(frozen=True)
class Estimate:
    """One mode's elasticities, one interval a coordinate."""

    mode: str  # with its setting: "fd 10 %"
    intervals: list[Interval]


@dataclass(frozen=True)
class Landscape:
    """The objective where it was computed along one coordinate, relative to the mean at z = 0."""

    z: Tensor  # (K,)
    value: Tensor  # (K, B)


@dataclass(frozen=True)
class Findings:
    """All that a report says."""

    labels: tuple[str, ...]
    outputs: list[Channel]  # whose SRMSE is differentiated: one, or all together
    srmse: list[float]  # of each draw
    n_steps: int
    switches: list[int]
    reallocations: list[int]
    estimates: list[Estimate]
    landscapes: list[Landscape]
    norms: dict[str, list[tuple[float, float]]]  # mode -> (horizon [s], norm)
    judge: str  # the estimate that verdicts go by
    events: dict[
        str, list[int]
    ]  # of the hybrid rollouts: located, sliding, unresolved, a draw each

    @property
    def unit(self) -> str:
        """Of the SRMSE; empty where outputs of different units are taken together."""
        units = {channel.unit for channel in self.outputs}
        return units.pop() if len(units) == 1 else ""

    def by(self, mode: str) -> Estimate:
        """The estimate of one mode."""
        return next(estimate for estimate in self.estimates if estimate.mode == mode)

    def verdict(self, estimate: Estimate, coordinate: int) -> str:
        """One estimate against the judge, in a few words."""
        return verdict(estimate.intervals[coordinate], self.by(self.judge).intervals[coordinate])


def verdict(found: Interval, judge: Interval) -> str:
    """agrees | biased by x | wrong sign | no signal | no gradient (exactly 0) | too wide to tell.

    It agrees where the difference is within both 95 % intervals together; no signal where the
    judge's interval contains 0 and this mode agrees with it and does not leave 0 out either. An
    interval wider than the judge's and the judged number together tells nothing.
    """
    if found.half > judge.half + abs(judge.mean):
        return "too wide to tell"
    spread = math.hypot(*(0.0 if math.isnan(i.half) else i.half for i in (found, judge)))
    agrees = abs(found.mean - judge.mean) <= spread
    if found.mean == 0.0 and not (agrees and not judge.excludes_zero):
        return "no gradient: exactly 0"
    if agrees:
        silent = not judge.excludes_zero and (found.mean == 0.0 or not found.excludes_zero)
        return "no signal" if silent else "agrees"
    if found.mean * judge.mean < 0 and found.excludes_zero and judge.excludes_zero:
        return "wrong sign"
    return f"biased by {found.mean - judge.mean:+.3f}"


def estimate_all(
    cfg: GradientReportConfig,
    ensemble: Ensemble,
    coordinates: Coordinates,
    progress: Callable[[str], object],
) -> Findings:
    """Every mode at the present constants. `progress` hears what comes next."""
    members, zero = len(ensemble), torch.zeros(coordinates.size, dtype=torch.float64)

    def of_outputs(run: Outcome) -> Tensor:
        each, chosen = srmse(run), cfg.of_output
        return each.square().sum(-1).sqrt() if chosen == 0 else each[..., chosen - 1]

    events: dict[str, list[int]] = {}

    def watch(run: Outcome) -> Tensor:
        if run.events is not None:
            events.update({k: v.tolist() for k, v in run.events._asdict().items()})
        return of_outputs(run)

    judge, watched = Judged(of_outputs, TOTALS), Judged(watch, TOTALS)
    points: list[tuple[Tensor, Tensor]] = []

    def values(z: Tensor) -> Tensor:
        found = ensemble.judged(coordinates.values(z), judge)
        points.append((z, found))
        return found

    progress("present constants")
    with torch.no_grad():
        now = ensemble.run({}, recording=TOTALS)
    each = judge(now)
    level = float(each.mean())
    estimates = []
    for step in cfg.steps:
        progress(f"differences over {100 * step:g} %")
        slope = differences(values, zero, members, step)
        estimates.append(Estimate(difference_name(step), _intervals(slope, level)))
    progress("smoothed")
    exact, _ = pathwise_slopes(ensemble, coordinates, zero, judge, "plain")
    control = control_of(exact, coordinates, cfg.control)
    slope = smoothed(values, zero, members, spread=cfg.spread, pairs=cfg.pairs, control=control)
    estimates.append(Estimate("smoothed", _intervals(slope, level)))
    norms: dict[str, list[tuple[float, float]]] = {}
    modes = pathwise_modes(ensemble)
    for mode in modes:
        for temperature in cfg.temperatures if mode == "soft" else [None]:
            name = mode if temperature is None else f"{mode} T = {temperature:g}"
            progress(name)
            slopes = exact
            if mode != "plain":
                slopes, _ = pathwise_slopes(ensemble, coordinates, zero, watched, mode, temperature)
            estimates.append(Estimate(name, _intervals(Slope.of_members(slopes, level), level)))
            norms[name] = [(ensemble.scenario.end, float(slopes.mean(dim=0).norm()) / level)]
    for horizon in sorted(cfg.horizons, reverse=True):
        if horizon >= ensemble.scenario.end:
            continue
        progress(f"norms at {horizon:g} s")
        short = ensemble.until(horizon)
        for mode in (mode for mode in ("plain", "hybrid") if mode in modes):
            slopes, value = pathwise_slopes(short, coordinates, zero, judge, mode)
            norms[mode].insert(0, (horizon, float(slopes.mean(dim=0).norm()) / value))
    return Findings(
        labels=coordinates.labels,
        outputs=list(now.outputs[max(0, cfg.of_output - 1) : cfg.of_output or None]),
        srmse=each.tolist(),
        n_steps=len(now.step_t) - 1,
        switches=switches(now).tolist(),
        reallocations=reallocations(now).tolist(),
        estimates=estimates,
        landscapes=[_landscape(points, each, level, i) for i in range(coordinates.size)],
        norms=norms,
        judge=difference_name(cfg.judge),
        events=events,
    )


def pathwise_modes(ensemble: Ensemble) -> list[str]:
    """Those that there are for its solver: events are located in steps of the implicit one."""
    return [m for m in PATHWISE if m != "hybrid" or isinstance(ensemble.solver, Implicit)]


def difference_name(step: float) -> str:
    """How the differences over a relative step are called."""
    return f"fd {100 * step:g} %"


def _intervals(slope: Slope, level: float) -> list[Interval]:
    return [
        Interval(mean / level, half / level)
        for mean, half in zip(slope.mean.tolist(), slope.half.tolist(), strict=True)
    ]


def _landscape(
    points: list[tuple[Tensor, Tensor]], now: Tensor, level: float, coordinate: int
) -> Landscape:
    """What was computed along one coordinate, in order; every member had the same z."""
    z, value = [torch.zeros(1, dtype=now.dtype)], [now.unsqueeze(0)]
    for place, found in points:
        along = place[:, 0, coordinate] != 0
        z.append(place[along, 0, coordinate])
        value.append(found[along])
    all_z = torch.cat(z)
    order = all_z.argsort()
    return Landscape(all_z[order], torch.cat(value)[order] / level)
