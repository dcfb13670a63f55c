"""Online regression under abrupt changes that return: the network alone and with a memory."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("online_regression")

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch import memory_figure
from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError

from .command.cli import command_line, reject_unknown, run_cli
from .learning.figures import errors_over_time
from .learning.online_learners import BASELINES
from .learning.online_measures import MEASURES, in_blocks
from .learning.online_passes import Learnt, learn
from .learning.report import (
    Report,
    by_variant,
    compare,
    conclude,
)
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .settings.checks import check_between, check_positive, check_variants
from .settings.machine import check_memory, check_workers
from .settings.memory_config import LEARNERS, OnlineRegressionConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_SAMPLES = 10**6  # of a pass


def main() -> None:
    """Command line of `python -m experiments.online_regression`."""
    run_cli("online_regression", checked, _task)


def checked(cfg: Any) -> OnlineRegressionConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, OnlineRegressionConfig)
    plain = cast(OnlineRegressionConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_variants(plain.variants, LEARNERS)
    check_between(plain, dict.fromkeys(("n_functions", "visits", "tuning_visits"), (2, 1000)))
    check_between(plain, dict.fromkeys(("n_hidden", "n_slots", "seeds"), (1, 10_000)))
    check_between(plain, {"member": (0, plain.seeds - 1), "seed": (0, 2**31)})
    positive = ("visit_length", "dt", "write_gain", "initial_std", "window")
    for name in (*positive, "recall_time", "sharpness"):
        check_positive(name, getattr(plain, name))
    if not plain.rates or len(set(plain.rates)) < len(plain.rates):
        raise ConfigError(f"rates = {plain.rates}: name each once, at least one")
    for rate in plain.rates:
        check_positive("rates", rate)
    for name in ("shift_threshold", "spread", "common"):
        number(name, getattr(plain, name), NONNEGATIVE)
    if not plain.dt <= plain.window / 10 or not plain.window <= plain.visit_length / 2:
        raise ConfigError(f"window = {plain.window}: 10 dt or more, half of visit_length or less")
    visits = plain.n_functions * max(plain.visits, plain.tuning_visits)
    if visits * plain.visit_length / plain.dt > MOST_SAMPLES:
        raise ConfigError(f"visit_length, dt and visits ask for over {MOST_SAMPLES:.0e} samples")
    check_workers(plain.workers)
    kept = plain.seeds * (plain.n_slots * plain.n_hidden + visits * plain.visit_length / plain.dt)
    check_memory("seeds, samples and sizes", 16 * kept * min(plain.workers, len(plain.variants)))
    return plain


def reported(cfg: OnlineRegressionConfig, found: Mapping[str, Learnt], wall_s: float) -> Report:
    """Tables, record and arrays of a run."""
    extra = {"rate": {variant: learnt.rate for variant, learnt in found.items()}}
    measures = {variant: learnt.measures for variant, learnt in found.items()}
    baselines = {v: base for v, base in BASELINES.items() if base in found}
    note = (
        f"{cfg.n_functions} functions, {cfg.visits} visits of {cfg.visit_length:g} s each, "
        f"{cfg.seeds} seeds: mean and 95 % interval over visits that are returns; the functions' "
        f"own RMS is {next(iter(found.values())).rms:.2f}. After a switch: the first "
        f"{cfg.window:g} s. Recovered: the error fell below half the function's RMS, and when; a "
        "visit without recovery counts whole. Before return, when left: on a function's points "
        "just before it comes back, and when it was last left (of readouts: the best slot). "
        "Better, worse: paired by seed against network, at 95 %, not corrected for their number. "
        f"Rate: the best of {', '.join(f'{rate:g}' for rate in cfg.rates)} after a switch, "
        "on other streams."
    )
    visits = range(cfg.n_functions * cfg.visits)
    header = ["variant", *(f"switch_{v}_function_{v % cfg.n_functions}" for v in visits)]
    rows = [[v, *learnt.switches.mean(axis=1).tolist()] for v, learnt in found.items()]
    block = _block(cfg)
    return Report(
        compare(MEASURES, measures, baselines, extra),
        note,
        {"units": {"recovery_s": "s"}, "wall_s": wall_s},
        by_variant({variant: learnt.arrays() for variant, learnt in found.items()}),
        {f"{variant}/rmse": in_blocks(learnt.rmse, block) for variant, learnt in found.items()},
        {"switches": [header, *rows]},
    )


def _block(cfg: OnlineRegressionConfig) -> int:
    return max(1, round(cfg.window / cfg.dt) // 4)


def pictures(cfg: OnlineRegressionConfig, found: Mapping[str, Learnt]) -> dict[str, Figure]:
    """Errors over time, and what each memory did."""
    block = _block(cfg)
    lines = {variant: in_blocks(learnt.rmse, block) for variant, learnt in found.items()}
    starts = [cfg.visit_length * v for v in range(cfg.n_functions * cfg.visits)]
    names = [f"f{v % cfg.n_functions + 1}" for v in range(len(starts))]
    figures = {"error": errors_over_time(lines, block * cfg.dt, starts, names)}
    traces = {variant: learnt.trace for variant, learnt in found.items() if learnt.trace}
    if traces:
        t = cfg.dt * np.arange(next(iter(found.values())).rmse.size)
        title = f"Online regression, seed {cfg.member}; dotted: the function changes"
        figures["memory"] = memory_figure(traces, t, title, starts[1:], "t [s]")
    return figures


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    start = time.perf_counter()
    tuning = len(plain.rates) * plain.tuning_visits if len(plain.rates) > 1 else 0
    found = all_parts(
        learn,
        {variant: (plain, variant) for variant in plain.variants},
        [plain.n_functions * (plain.visits + tuning)] * len(plain.variants),
        npz_parts(Learnt, folder / "finished"),
        plain.workers,
        "visit",
        1,
    )
    report = reported(plain, found, time.perf_counter() - start)
    command = command_line("online_regression")
    conclude(folder, plain, command, report, lambda: pictures(plain, found))


if __name__ == "__main__":
    main()
