"""What the comparison of sequence models leaves behind: a table a task, arrays, a record."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..learning.report import Comparison, Measure, Report, compare, markdown
from ..sequence_tasks.every import TASKS
from ..sequence_tasks.task import Task
from ..settings.peers_config import PeersConfig, TaskConfig
from .training import Learned, first_near_best, test_sequences

#: Trainings by task and variant, a seed each.
Found = Mapping[str, Mapping[str, Sequence[Learned]]]
BASELINE = "lstm"


def measured(task: Task, runs: Sequence[Learned]) -> dict[str, np.ndarray]:
    """Measures (seeds,) by name."""
    best = [first_near_best(run.curve, task.lower_is_better) for run in runs]
    lost = np.array([place < 0 for place in best])

    def there(values: list[np.ndarray]) -> np.ndarray:
        picked = [float(row[place]) for row, place in zip(values, best, strict=True)]
        return np.where(lost, np.nan, picked)

    return {
        "score": np.array([run.score for run in runs]),
        "training_s": np.array([float(run.seconds[-1]) for run in runs]),
        "best_s": there([run.seconds for run in runs]),
        "best_iterations": there([run.at for run in runs]),
    }


def reported(cfg: PeersConfig, found: Found, missing: Mapping[str, str], wall_s: float) -> Report:
    """Table, record and arrays of a run; `missing`: variants that could not run, and why."""
    parts, texts, known = {}, [], {}
    arrays: dict[str, np.ndarray] = {}
    for name, runs in found.items():
        task = TASKS[name](cfg)
        known[name] = task.known(test_sequences(cfg, name))
        parts[name] = with_missing(compared(task, runs), cfg.variants, missing)
        texts += [f"### {name}", described(cfg, name, known[name]), parts[name].markdown]
        for variant, trainings in runs.items():
            arrays |= {
                f"{name}/{variant}/{key}": array
                for key, array in (*stacked(trainings).items(), *trainings[0].trace.items())
            }
    header = next(iter(parts.values())).header
    rows = [[name, *row] for name, part in parts.items() for row in part.rows]
    curves = {
        f"{name}/{variant}": mean_curve(trainings)
        for name, runs in found.items()
        for variant, trainings in runs.items()
    }
    return Report(
        Comparison(["task", *header], rows, "\n\n".join(texts)),
        note(cfg, missing),
        {"known": known, "missing": dict(missing), "wall_s": wall_s},
        arrays,
        curves,
        {},
    )


def compared(task: Task, runs: Mapping[str, Sequence[Learned]]) -> Comparison:
    """One task's table."""
    values = {variant: measured(task, each) for variant, each in runs.items()}
    extra: dict[str, dict[str, object]] = {
        "size": {v: each[0].size for v, each in runs.items()},
        "parameters": {v: each[0].parameters for v, each in runs.items()},
        "start [s]": {v: round(max(run.start_s for run in each), 2) for v, each in runs.items()},
        "iterations": {v: max(int(run.at[-1]) for run in each) for v, each in runs.items()},
        "least": {v: f"{values[v]['score'].min():.2f}" for v in runs},
        "most": {v: f"{values[v]['score'].max():.2f}" for v in runs},
    }
    measures = (
        Measure("score", task.measure, 2, task.lower_is_better),
        Measure("training_s", "training [s]", 1),
        Measure("best_s", "to its best [s]", 1),
        Measure("best_iterations", "to its best [iterations]", 0),
    )
    return compare(measures, values, {v: BASELINE for v in runs if v != BASELINE}, extra)


def with_missing(part: Comparison, order: Sequence[str], missing: Mapping[str, str]) -> Comparison:
    """A row for every variant that could not run, in its place."""
    head, rule, *lines = part.markdown.splitlines()
    said = {str(row[0]): (row, line) for row, line in zip(part.rows, lines, strict=True)}
    width = head.count("|") - 1
    for variant, why in missing.items():
        row: list[object] = [variant, *[math.nan] * (len(part.header) - 1)]
        for place, name in enumerate(part.header):
            if name.endswith("_verdict"):
                row[place] = why
        cells = [variant, why, *[""] * (width - 2)]
        said[variant] = (row, markdown(cells, []).splitlines()[0])
    chosen = [said[variant] for variant in order]
    return Comparison(
        part.header, [row for row, _ in chosen], "\n".join([head, rule, *(t for _, t in chosen)])
    )


def stacked(runs: Sequence[Learned]) -> dict[str, np.ndarray]:
    """Of all seeds: curves (seeds, P), NaN where a training had ended, and scores (seeds,)."""
    longest = max(len(run.curve) for run in runs)

    def padded(rows: list[np.ndarray]) -> np.ndarray:
        gaps = [np.full(longest - len(row), np.nan) for row in rows]
        return np.stack([np.concatenate(pair) for pair in zip(rows, gaps, strict=True)])

    return {
        "score": np.array([run.score for run in runs]),
        "curve": padded([run.curve for run in runs]),
        "iterations": padded([run.at for run in runs]),
        "seconds": padded([run.seconds for run in runs]),
    }


def mean_curve(runs: Sequence[Learned]) -> np.ndarray:
    """Mean score over seeds at every evaluation (P,); a training that has ended keeps its last."""
    longest = max(len(run.curve) for run in runs)
    places = [np.minimum(np.arange(longest), len(run.curve) - 1) for run in runs]
    held = [run.curve[place] for run, place in zip(runs, places, strict=True)]
    mean: np.ndarray = np.mean(held, axis=0)
    return mean


def described(cfg: PeersConfig, name: str, known: Mapping[str, float]) -> str:
    """What the task was, and what can be had without learning it."""
    settings: TaskConfig = getattr(cfg, name)
    sizes = ", ".join(f"{key} = {value}" for key, value in vars(settings).items())
    without = ", ".join(f"{what} gives {score:.2f}" for what, score in known.items())
    return f"{sizes}; {without}."


def note(cfg: PeersConfig, missing: Mapping[str, str]) -> str:
    """How to read the tables."""
    rates = ", ".join(f"{variant} {cfg.rates[variant]:g}" for variant in cfg.variants)
    shares = ", ".join(
        f"{v} {cfg.shares[v]:g}" for v in cfg.variants if cfg.shares.get(v, 1.0) != 1.0
    )
    told = f" Times a task's iterations: {shares}." if shares else ""
    lost = "".join(f" {variant}: {why}." for variant, why in missing.items())
    return (
        f"Mean and 95 % interval over {cfg.seeds} seeds, least and most of them, on {cfg.tested} "
        "new sequences; relative RMSE: in parts of the RMS of what was to be answered. Better, "
        f"worse: than {BASELINE}, paired by seed, at 95 %, not corrected for their number. All see "
        "the same sequences, and have a width (size) that gives them the parameters of `memory`. "
        "Training ends after the iterations that a task has, or sooner, once two evaluations in a "
        "row have found every answer right; its time is one thread's, without evaluations; start: "
        "the first pass and gradient, compiling included, the longest of the seeds. To its best: "
        "time and iterations to the first "
        f"evaluation (every {cfg.every} iterations, {cfg.evaluated} sequences) within 0.01 of the "
        f"best accuracy, or 1 % of the best error. Rates of Adam: {rates}.{told}{lost}"
    )
