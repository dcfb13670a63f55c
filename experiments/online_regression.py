"""Online regression under abrupt changes that return: the network alone and with a memory."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf
from torch import Tensor

import mann_torch as mt
from mann_torch.errors import ConfigError
from mann_torch.memory import MemoryTrace
from mann_torch.trees import map_tensors

from .cli import command_line, reject_unknown, run_cli
from .figures import curves
from .memory_config import OnlineRegressionConfig
from .memory_report import (
    check_at_least,
    check_positive,
    check_variants,
    interval,
    markdown,
    shown,
    trace_arrays,
    verdict,
    write_all,
)
from .online_learners import (
    BASELINES,
    FINGERPRINT_TIME,
    PRINTS,
    VARIANTS,
    OnlineLearner,
    draw_stream,
)
from .simulate import progress_bar
from .writing import write_text

MEASURES = ("after_switch", "steady", "recovery_s", "forgotten")
HEADER = ("variant", *(f"{m}{end}" for m in MEASURES for end in ("", "_half")), "against")
PROBES = 64  # points of a forgetting test


@dataclass(frozen=True)
class Learnt:
    """One variant on all seeds' streams."""

    measures: dict[str, np.ndarray]  # (seeds,) each, over the visits that are returns
    rmse: np.ndarray  # (visits, samples) over seeds, smoothed by the caller
    trace: MemoryTrace | None  # of seed `member`


def main() -> None:
    """Command line of `python -m experiments.online_regression`."""
    run_cli("online_regression", checked, _task)


def checked(cfg: Any) -> OnlineRegressionConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, OnlineRegressionConfig)
    plain = cast(OnlineRegressionConfig, OmegaConf.to_object(cfg))
    check_variants(plain.variants, VARIANTS)
    check_at_least(plain, {"n_functions": 2, "visits": 2, "n_hidden": 1, "n_slots": 1, "seeds": 1})
    check_at_least(plain, {"member": 0, "seed": 0})
    positive = ("visit_length", "dt", "rate", "write_gain", "key_rate", "initial_std", "window")
    check_positive(plain, positive)
    if not (math.isfinite(plain.shift_threshold) and plain.shift_threshold >= 0):
        raise ConfigError(f"shift_threshold = {plain.shift_threshold}: must be finite and >= 0")
    if plain.member >= plain.seeds:
        raise ConfigError(f"member = {plain.member}: there are {plain.seeds} seeds, from 0")
    if not plain.dt <= plain.window / 10 or not plain.window <= plain.visit_length / 2:
        raise ConfigError(
            f"window = {plain.window}: at least 10 dt and at most half of visit_length"
        )
    return plain


@torch.inference_mode()
def learn(cfg: OnlineRegressionConfig, variant: str, progress: Callable[[], object]) -> Learnt:
    """One pass over the streams; the draws are the same for every variant."""
    torch.manual_seed(cfg.seed)
    generator = torch.Generator().manual_seed(cfg.seed)
    stream = draw_stream(cfg, generator)
    learner = OnlineLearner(cfg, variant)
    spread = torch.randn(cfg.seeds, cfg.n_slots, PRINTS, generator=generator, dtype=torch.float64)
    weights = torch.Generator().manual_seed(cfg.seed + 1)
    state = learner.start(cfg, weights)
    probes = [stream.samples(k, PROBES, generator) for k in range(cfg.n_functions)]
    per_visit = round(cfg.visit_length / cfg.dt)
    squared, probed, rows = [], [], []
    prints = torch.zeros(cfg.seeds, PRINTS, dtype=torch.float64)
    for visit in range(cfg.n_functions * cfg.visits):
        inputs, answers, basis = stream.samples(visit % cfg.n_functions, per_visit, generator)
        if visit == 0:
            state = learner.begin(state, inputs[0], prints, 0.3 * spread)
        for step in range(per_visit):
            looked, before = learner.look(state, inputs[step], prints, jump=True), state.cell
            error = answers[step] - looked.prediction
            state = learner.update(state, inputs[step], error, looked)
            new = answers[step].unsqueeze(-1) * basis[step]
            prints = prints + min(1.0, cfg.dt / FINGERPRINT_TIME) * (new - prints)
            squared.append(error.square())
            if looked.seen is not None and before is not None and state.cell is not None:
                row = MemoryTrace.row(before, looked.seen, state.cell)
                rows.append(map_tensors(lambda leaf: leaf[cfg.member].clone(), row))
        probed.append(torch.stack([_probe(learner, state, *probe) for probe in probes]))
        progress()
    errors = torch.stack(squared).reshape(-1, per_visit, cfg.seeds)
    rmse = errors.mean(dim=-1).sqrt().numpy()
    measures = _measures(cfg, errors, torch.stack(probed), stream_rms(cfg, probes))
    return Learnt(measures, rmse, MemoryTrace.stack(rows) if rows else None)


def stream_rms(cfg: OnlineRegressionConfig, probes: list[tuple[Tensor, Tensor, Tensor]]) -> Tensor:
    """Root mean square of the answers over all functions (B,)."""
    return torch.stack([answers for _, answers, _ in probes]).square().mean(dim=(0, 1)).sqrt()


def _probe(
    learner: OnlineLearner, state: Any, inputs: Tensor, answers: Tensor, basis: Tensor
) -> Tensor:
    """RMSE (B,) on a function's points, nothing learned; told which one by its fingerprint."""
    prints = (answers.unsqueeze(-1) * basis).mean(dim=0).expand(len(inputs), -1, -1)
    prediction = learner.look(state, inputs, prints, jump=False).prediction
    return (answers - prediction).square().mean(dim=0).sqrt()


def _measures(
    cfg: OnlineRegressionConfig, squared: Tensor, probed: Tensor, rms: Tensor
) -> dict[str, np.ndarray]:
    """Of squared errors (visits, samples, B) and probes (visits, K, B): returns alone count."""
    K, window = cfg.n_functions, round(cfg.window / cfg.dt)
    back = squared[K:]
    pieces = back[:, : back.shape[1] // (window // 2) * (window // 2)]
    pieces = pieces.unflatten(1, (-1, window // 2)).mean(dim=2).sqrt()
    good = pieces < 0.5 * rms
    first = torch.where(good.any(dim=1), good.int().argmax(dim=1), good.shape[1])
    visits = range(K, len(probed))
    lost = torch.stack([probed[v - 1, v % K] - probed[v - K, v % K] for v in visits])
    found = {
        "after_switch": back[:, :window].mean(dim=1).sqrt().mean(dim=0),
        "steady": back[:, -2 * window :].mean(dim=1).sqrt().mean(dim=0),
        "recovery_s": first.double().mean(dim=0) * (window // 2) * cfg.dt,
        "forgotten": lost.mean(dim=0),
    }
    return {name: value.numpy() for name, value in found.items()}


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    torch.set_num_threads(1)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command = command_line("experiments.online_regression")
    write_text(folder / "config.yaml", OmegaConf.to_yaml(cfg, resolve=True))
    start = time.perf_counter()
    visits = plain.n_functions * plain.visits
    with progress_bar(len(plain.variants) * visits, "visit") as bar:
        found = {variant: learn(plain, variant, bar.update) for variant in plain.variants}
    wall_s = time.perf_counter() - start
    rows: list[tuple[object, ...]] = []
    lines = []
    for variant, learnt in found.items():
        numbers = [interval(learnt.measures[name]) for name in MEASURES]
        said = "-"
        base = BASELINES.get(variant)
        if base in found:
            other = found[base].measures["after_switch"]
            said = verdict(learnt.measures["after_switch"], other, lower_is_better=True)
            said += f" ({base})"
        rows.append((variant, *(value for pair in numbers for value in pair), said))
        texts = [shown(*pair, 2 if n == 2 else 3) for n, pair in enumerate(numbers)]
        lines.append([variant, *texts, said])
    first = f"RMSE, first {plain.window:g} s"
    header = ("variant", first, "RMSE, steady", "recovery [s]", "forgotten", "against")
    table = markdown(header, lines)
    note = (
        f"{plain.n_functions} functions, {plain.visits} visits of {plain.visit_length:g} s each, "
        f"{plain.seeds} seeds: mean and 95 % interval over visits that are returns. Recovery: "
        "until the error is below half the functions' RMS (the whole visit, if never). Forgotten: "
        "RMSE on a function just before it returns, less that when it was left. Last column: RMSE "
        "after a switch, paired by seed."
    )
    figures, scalars = {}, {}
    traces = {variant: learnt.trace for variant, learnt in found.items() if learnt.trace}
    block = round(plain.window / plain.dt) // 4
    for variant, learnt in found.items():
        whole = learnt.rmse.size // block * block
        blocks = learnt.rmse.reshape(-1)[:whole].reshape(-1, block)
        scalars[f"{variant}/rmse"] = np.sqrt((blocks**2).mean(axis=1))
    if plain.figures:
        marks = [plain.visit_length * v for v in range(1, visits)]
        x = {v: block * plain.dt * np.arange(len(scalars[f"{v}/rmse"])) for v in found}
        shown_lines = {v: scalars[f"{v}/rmse"] for v in found}
        labels = ("t [s]", "RMSE over seeds")
        figures["error"] = curves(shown_lines, x, labels, "Online regression", False, marks)
        if traces:
            members = {v: trace.member() for v, trace in traces.items()}
            t = plain.dt * np.arange(len(next(iter(traces.values())).attended))
            title = f"Online regression, seed {plain.member}; dotted: the function changes"
            figures["memory"] = mt.memory_figure(members, t, title, marks, "t [s]")
    arrays = {f"{v}/{m}": a for v, learnt in found.items() for m, a in learnt.measures.items()}
    arrays |= {f"{v}/rmse": learnt.rmse for v, learnt in found.items()}
    arrays |= trace_arrays(traces)
    record = {
        "table": [dict(zip(HEADER, row, strict=True)) for row in rows],
        "units": {"recovery_s": "s"},
        "wall_s": wall_s,
        "command": command,
    }
    report = f"`{command}`\n\n{table}\n\n{note}\n"
    write_all(folder, plain, record, HEADER, rows, report, arrays, figures, scalars)
    print(f"{table}\n\n{note} {wall_s:.0f} s in all\nwritten to {folder}", flush=True)


if __name__ == "__main__":
    main()
