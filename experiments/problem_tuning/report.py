"""What tuning benchmark problems came to: a table beside published constants, and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..learning.report import Measure, Report, compare, interval
from ..runs.figures import COLOURS
from ..settings.problem_tuning_config import ProblemTuningConfig
from .judging import Found
from .tuned_problem import TunedProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: By problem and way.
Everything = Mapping[tuple[str, str], Found]
MEASURES = (
    Measure("rms_error", "RMS error", 5),
    Measure("rms_input", "RMS input", 3),
)


def change(new: np.ndarray, base: np.ndarray) -> str:
    """Paired mean change [%] of the base's mean, with its 95 % interval."""
    mean, half = interval(100.0 * (new - base) / base.mean())
    return f"{mean:+.2f} ± {half:.2f} %"


def reported(
    cfg: ProblemTuningConfig,
    tasks: Mapping[str, TunedProblem],
    found: Everything,
    wall_s: float,
) -> Report:
    """Each way beside the first of its problem."""
    names = {key: "/".join(key) for key in found}
    bases = {key: (key[0], next(iter(tasks[key[0]].ways))) for key in found}
    measures = {
        names[key]: {"rms_error": one.error, "rms_input": one.effort} for key, one in found.items()
    }
    pairs = {names[key]: (one, found[bases[key]]) for key, one in found.items()}
    extra = {
        "constants": {names[k]: tasks[k[0]].ways[k[1]].note for k in found},
        "change of RMS error": {n: change(a.error, b.error) for n, (a, b) in pairs.items()},
        "change of RMS input": {n: change(a.effort, b.effort) for n, (a, b) in pairs.items()},
    }
    baselines = {names[key]: names[base] for key, base in bases.items() if key != base}
    note = (
        f"Tuned on {cfg.train} members by {cfg.iterations} iterations, RMS input at most "
        f"{cfg.effort_limit:g} times what it was where tuning began; judged on {cfg.held_out} "
        "others, which nothing was chosen by. Mean and 95 % interval over them; changes, better "
        "and worse are paired by member, against the first way of each problem. Errors in "
        + "; ".join(f"{name} ({task.title}): {task.unit}" for name, task in tasks.items())
        + "."
    )
    arrays: dict[str, np.ndarray] = {}
    for key, one in found.items():
        own = {"rms_error": one.error, "rms_input": one.effort, "objective": one.objective}
        own |= {f"constants/{name}": value for name, value in one.constants.items()}
        arrays |= {f"{names[key]}/{name}": value for name, value in own.items()}
    rows: list[list[object]] = [["problem", "way", "constant", "value"]]
    rows += [
        [*key, name, value.tolist()]
        for key, one in found.items()
        for name, value in one.constants.items()
        if value.size <= 16
    ]
    return Report(
        compare(MEASURES, measures, baselines, extra),
        note,
        {"wall_s": wall_s},
        arrays,
        {names[key]: one.objective for key, one in found.items() if len(one.objective)},
        {"constants": rows},
    )


def pictures(tasks: Mapping[str, TunedProblem], found: Everything) -> dict[str, Figure]:
    """A problem each: training, and every held-out member beside the published constants."""
    return {name: _picture(name, task, found) for name, task in tasks.items()}


def _picture(problem: str, task: TunedProblem, found: Everything) -> Figure:
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    base = found[problem, next(iter(task.ways))]
    for colour, way in zip(COLOURS, task.ways, strict=False):
        one = found[problem, way]
        if len(one.objective):
            steps = np.arange(1, len(one.objective) + 1)
            left.semilogy(steps, one.objective, color=colour, label=way)
        right.loglog(base.error, one.error, ".", ms=4, color=colour, label=way)
    edges = [base.error.min(), base.error.max()]
    right.plot(edges, edges, color="0.6", lw=0.8, zorder=0)
    left.set_xlabel("iteration")
    left.set_ylabel("objective (where tuning began: 1)")
    right.set_xlabel(f"RMS error with {next(iter(task.ways))} constants [{task.unit}]")
    right.set_ylabel("RMS error of the same member")
    right.xaxis.set_minor_formatter(NullFormatter())
    for ax in (left, right):
        ax.grid(alpha=0.3)
        ax.legend(fontsize="small")
    figure.suptitle(f"{task.title}: tuned, and judged on members not tuned on")
    return figure
