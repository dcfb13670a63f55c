"""Online regression under abrupt changes that return: the network alone and with a memory."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("online_regression")

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf
from torch import Tensor

from mann_torch import memory_figure
from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError
from mann_torch.memory import MemoryTrace
from mann_torch.trees import map_tensors

from .command.cli import command_line, reject_unknown, run_cli
from .learning.figures import errors_over_time
from .learning.online_learners import (
    BASELINES,
    Learner,
    OnlineLearner,
    samples,
)
from .learning.online_measures import MEASURES, after_each_switch, in_blocks, measured
from .learning.report import (
    Report,
    by_variant,
    compare,
    conclude,
    member_arrays,
)
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .sequence_tasks.streams import draw_stream, uniform
from .settings.checks import check_between, check_positive, check_variants
from .settings.machine import check_memory, check_workers
from .settings.memory_config import LEARNERS, OnlineRegressionConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PROBES = 64  # points of a forgetting test
TEST, TUNING = 0, 1  # streams
MOST_SAMPLES = 10**6  # of a pass


@dataclass(frozen=True)
class Learnt:
    """One variant on all seeds' streams, at its best rate."""

    rate: float
    measures: dict[str, np.ndarray]  # (seeds,) each, over the visits that are returns
    rmse: np.ndarray  # (visits, samples) over seeds
    switches: np.ndarray  # (visits, seeds) RMSE after each switch
    rms: float  # of the functions
    trace: dict[str, np.ndarray]  # of seed `member`; empty without a memory

    def arrays(self) -> dict[str, np.ndarray]:
        """All of it by name."""
        own = {"rate": np.array(self.rate), "rmse": self.rmse, "after_each_switch": self.switches}
        return {**self.measures, **own, **self.trace}


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


def learn(
    cfg: OnlineRegressionConfig, variant: str, progress: Callable[[int], object] = lambda n: None
) -> Learnt:
    """Choose the variant's rate on streams of their own, then take it to the test's."""
    torch.set_num_threads(1)  # the tensors are small
    scores = []
    for rate in cfg.rates if len(cfg.rates) > 1 else ():
        tried = one_pass(cfg, variant, rate, TUNING, cfg.tuning_visits, progress)
        score = float(tried.measures["after_switch"].mean())
        scores.append(score if math.isfinite(score) else math.inf)
    best = cfg.rates[int(np.argmin(scores))] if scores else cfg.rates[0]
    return one_pass(cfg, variant, best, TEST, cfg.visits, progress)


@torch.inference_mode()
def one_pass(
    cfg: OnlineRegressionConfig,
    variant: str,
    rate: float,
    streams: int,
    visits: int,
    progress: Callable[[int], object],
) -> Learnt:
    """One pass over the streams; the draws are the same for every variant and rate."""
    seeds = np.random.SeedSequence([cfg.seed, streams]).generate_state(2, np.uint64)
    generator, weights = (torch.Generator().manual_seed(int(seed >> 1)) for seed in seeds)
    stream = draw_stream(cfg.seeds, cfg.n_functions, generator)
    learner = OnlineLearner(cfg, variant, rate)
    state = learner.start(cfg, weights)
    probes = [samples(stream, k, PROBES, generator) for k in range(cfg.n_functions)]
    per_visit = round(cfg.visit_length / cfg.dt)
    squared, probed, rows = [], [], []
    for visit in range(cfg.n_functions * visits):
        inputs, answers = samples(stream, visit % cfg.n_functions, per_visit, generator)
        if visit == 0:
            state = learner.begin(state, uniform(weights, cfg.n_slots, *inputs.shape[1:]))
        elif cfg.wiped:
            state = learner.wiped(state)
        for step in range(per_visit):
            looked, before = learner.look(state, inputs[step], jump=True), state.cell
            error = answers[step] - looked.prediction
            state = learner.update(state, inputs[step], error, looked)
            squared.append(error.square())
            if looked.seen is not None and before is not None and state.cell is not None:
                row = MemoryTrace.row(before, looked.seen, state.cell)
                rows.append(map_tensors(lambda leaf: leaf[cfg.member].clone(), row))
        probed.append(torch.stack([_probe(learner, state, *probe) for probe in probes]))
        progress(1)
    errors = torch.stack(squared).reshape(-1, per_visit, cfg.seeds)
    rms = torch.stack([answers for _, answers in probes]).square().mean(dim=1).sqrt()
    return Learnt(
        rate,
        measured(cfg, errors, torch.stack(probed), rms),
        errors.mean(dim=-1).sqrt().numpy(),
        after_each_switch(cfg, errors),
        float(rms.square().mean().sqrt()),
        member_arrays(MemoryTrace.stack(rows)) if rows else {},
    )


def _probe(learner: OnlineLearner, state: Learner, inputs: Tensor, answers: Tensor) -> Tensor:
    """RMSE (B,) on a function's points, nothing learned; of readouts, of the best slot."""
    found = learner.held(state, inputs)  # (S, points, B)
    return (answers - found).square().mean(dim=1).sqrt().amin(dim=0)


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
    command = command_line("experiments.online_regression")
    conclude(folder, plain, command, report, lambda: pictures(plain, found))


if __name__ == "__main__":
    main()
