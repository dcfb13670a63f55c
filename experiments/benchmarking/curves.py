"""Two curves of the compiled engine: cost against horizon and batch, accuracy against work."""

from __future__ import annotations

import time
from typing import cast

import numpy as np
import torch
from matplotlib.figure import Figure
from omegaconf import OmegaConf

import mann_torch as mt

from ..building.build import Experiment
from ..command.cli import compose_job
from ..reproduction.jobs import batches
from ..reproduction.plan import Job
from ..runs.figures import beside
from ..runs.writing import aligned
from ..settings.config import ReproduceConfig
from .measure import Section, verdict
from .row import experiment

HORIZONS, BATCHES = (41.25, 82.5, 165.0, 330.0), (1, 8, 64, 512)
LINEAR = 1.15  # what noise and caches may add to linear cost
STEPS = (1e-3, 2e-3, 4e-3, 5e-3, 8e-3, 1e-2)
LIMIT_STEP = 2.5e-4


def scaling() -> Section:
    """What a horizon and a batch cost, forward."""
    seconds, table = _scaling()
    body = [["what it must show", "here", ""]]
    body += [[text, value, verdict(held)] for text, value, held in linearity(seconds)]
    text = f"""Wall time of a forward rollout, soft attention, all cores, the least of three.

{table}

{aligned(body)}

![Cost against horizon and batch](docs/benchmark_scaling.png)"""
    return Section(text, seconds.tolist(), {"benchmark_scaling": _scaling_figure(seconds)})


def linearity(seconds: np.ndarray) -> list[tuple[str, str, bool]]:
    """Whether the largest horizon and batch cost no more than their share: text, figure, held."""
    largest = seconds[-1, -1]
    horizon, batch = HORIZONS[-1] / HORIZONS[0], BATCHES[-1] / BATCHES[-2]
    found = []
    for what, times, before in (
        (f"{HORIZONS[-1]:g} s for {HORIZONS[0]:g} s, B = {BATCHES[-1]}", horizon, seconds[-1, 0]),
        (f"B = {BATCHES[-1]} for B = {BATCHES[-2]}, {HORIZONS[-1]:g} s", batch, seconds[-2, -1]),
    ):
        ratio, most = largest / before, LINEAR * times
        found.append((f"{what}: at most {most:.3g} x", f"{ratio:.3g} x", bool(ratio <= most)))
    return found


def precision() -> Section:
    """How far off a step is, and what it costs."""
    numbers, table = _precision()
    text = f"""Largest deviation of the SRMSE (whole run and t > 10 s, both joints, scenarios 1, 2,
4, 5, 6 of 330 s) from its limit, the W-method at 0.25 ms. `following` is the default: the
reference's motion enters the stages (`Implicit.follow_reference`).

{table}

![Accuracy against work](docs/work_precision.png)"""
    return Section(text, numbers, {"work_precision": _precision_figure(numbers)})


def _timed(made: Experiment, solver: mt.Solver, repeats: int) -> tuple[float, mt.Trajectory]:
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        with torch.inference_mode():
            run = mt.rollout(
                made.loop,
                made.scenario,
                solver,
                weights=made.weights,
                engine="compiled",
                motion_dt=0.1,
                sample_until=0.0,
            )
        best = min(best, time.perf_counter() - start)
    return best, run


def _scaling() -> tuple[np.ndarray, str]:
    seconds = np.zeros((len(BATCHES), len(HORIZONS)))
    _timed(experiment(1, 1.0), mt.Implicit(), 1)
    for i, batch in enumerate(BATCHES):
        for j, horizon in enumerate(HORIZONS):
            seconds[i, j], _ = _timed(experiment(batch, horizon), mt.Implicit(), 3)
    body = [["B", *[f"{horizon:g} s" for horizon in HORIZONS], "us a step and trajectory"]]
    for batch, row in zip(BATCHES, seconds, strict=True):
        each = 1e6 * row[-1] / batch / HORIZONS[-1] * mt.Implicit().dt
        body.append([str(batch), *[f"{value:.3f} s" for value in row], f"{each:.2f}"])
    return seconds, aligned(body)


def _scaling_figure(seconds: np.ndarray) -> Figure:
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for batch, row in zip(BATCHES, seconds, strict=True):
        left.loglog(HORIZONS, row, "o-", label=f"B = {batch}")
    for horizon, column in zip(HORIZONS, seconds.T, strict=True):
        right.loglog(BATCHES, column, "o-", label=f"{horizon:g} s")
    for ax, axis, name in ((left, HORIZONS, "horizon [s]"), (right, BATCHES, "batch B")):
        grid = np.array([axis[0], axis[-1]], dtype=float)
        level = seconds[-1, 0] if ax is left else seconds[0, -1]
        ax.loglog(grid, level * grid / grid[0], "k:", label="linear")
        ax.set_xlabel(name)
        ax.set_ylabel("wall time [s]")
    beside(right, fontsize="small")
    beside(left, fontsize="small")
    figure.suptitle("Compiled engine, forward")
    return figure


def _precision() -> tuple[dict[str, list[float]], str]:
    """Largest deviation [%] and time [s] of each controller, form of the method and step."""
    found: dict[str, list[float]] = {}
    cfg = cast(ReproduceConfig, OmegaConf.to_object(compose_job("reproduce", ["draws=1"])))
    for variant in ("nn", "soft"):
        job = Job(variant, list(cfg.variants[variant]), ["1", "2", "4", "5", "6"])
        ((_, made),) = batches(cfg, job)

        def srmse(solver: mt.Solver, made: Experiment = made) -> tuple[float, np.ndarray]:
            seconds, run = _timed(made, solver, 1)
            figures = [mt.srmse(run).numpy(), mt.srmse(run, after=10.0).numpy()]
            return seconds, np.stack(figures)

        _, limit = srmse(mt.Implicit(LIMIT_STEP))
        for follow in (True, False):
            srmse(mt.Implicit(0.1, follow_reference=follow))  # compiles
            off, times = [], []
            for dt in STEPS:
                seconds, figures = srmse(mt.Implicit(dt, follow_reference=follow))
                off.append(float(100 * np.abs(figures / limit - 1).max()))
                times.append(seconds)
            name = f"{variant}, {'following' if follow else 'not following'}"
            found[name], found[f"{name}: seconds"] = off, times
    body = [["controller", *[f"{1e3 * dt:g} ms" for dt in STEPS]]]
    for name, values in found.items():
        if not name.endswith("seconds"):
            body.append([name, *[f"{value:.3f} %" for value in values]])
    return found, aligned(body)


def _precision_figure(found: dict[str, list[float]]) -> Figure:
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    ax = figure.subplots()
    for name, off in found.items():
        if not name.endswith("seconds"):
            style = "o-" if ", following" in name else "s--"
            times = found[f"{name}: seconds"]
            ax.loglog(times, off, style, label=name)
            for dt, x, y in zip(STEPS, times, off, strict=True):
                label = f"{1e3 * dt:g} ms"
                ax.annotate(label, (x, y), fontsize=6, xytext=(3, 3), textcoords="offset points")
    ax.axhline(0.25, color="k", lw=0.8, ls=":", label="0.25 %")
    ax.set_xlabel("wall time of five rollouts of 330 s [s]")
    ax.set_ylabel("largest deviation of SRMSE [%]")
    beside(ax, fontsize="small")
    return figure
