"""Associative recall by backpropagation: the cell beside nn.LSTM and nn.GRU."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf
from torch import nn

import mann_torch as mt
from mann_torch.errors import ConfigError
from mann_torch.memory import MemoryTrace

from .cli import command_line, reject_unknown, run_cli
from .figures import curves
from .memory_config import RecallConfig
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
from .recall_models import (
    LONG,
    VARIANTS,
    Memory,
    build_model,
    n_parameters,
    sequences,
    without_keys,
)
from .simulate import progress_bar
from .writing import write_text

HEADER = ("variant", "accuracy", "half", "parameters", "iterations", "wall_s", "against_lstm")
POINTS = 50  # of a learning curve


@dataclass(frozen=True)
class Learned:
    """One training: accuracy on new sequences, the learning curve, what the memory did."""

    accuracy: float
    loss: np.ndarray  # (POINTS,) means over stretches of training
    parameters: int
    iterations: int
    wall_s: float
    trace: MemoryTrace | None


def main() -> None:
    """Command line of `python -m experiments.recall`."""
    run_cli("recall", checked, _task)


def checked(cfg: Any) -> RecallConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, RecallConfig)
    plain = cast(RecallConfig, OmegaConf.to_object(cfg))
    check_variants(plain.variants, VARIANTS)
    least = ("n_keys", "n_pairs", "n_slots", "hidden_size", "context_size", "batch", "longer")
    check_at_least(plain, {**dict.fromkeys(least, 1), "n_values": 2, "iterations": POINTS})
    check_at_least(plain, {"test_sequences": 1, "seeds": 1, "workers": 1, "member": 0, "seed": 0})
    check_positive(plain, ("rate", "temperature"))
    if plain.n_pairs > plain.n_keys:
        raise ConfigError(f"n_pairs = {plain.n_pairs}: no key comes twice, n_keys is too small")
    if plain.member >= plain.test_sequences:
        raise ConfigError(f"member = {plain.member}: there are {plain.test_sequences} sequences")
    return plain


def learn(cfg: RecallConfig, variant: str, seed: int) -> Learned:
    """Train one model from one seed, then test it."""
    torch.set_num_threads(1)
    torch.manual_seed(cfg.seed + seed)
    generator = torch.Generator().manual_seed(cfg.seed + seed)
    model = build_model(cfg, variant)
    free = [p for p in model.parameters() if p.requires_grad]
    optimizer = torch.optim.Adam(free, lr=cfg.rate)
    iterations = cfg.iterations * (cfg.longer if variant.endswith(LONG) else 1)
    losses, start = np.zeros(iterations), time.perf_counter()
    for iteration in range(iterations):
        x, answer = sequences(cfg, cfg.batch, generator)
        scores = model(x)[cfg.n_pairs :]
        loss = nn.functional.cross_entropy(scores.flatten(0, 1), answer.flatten())
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(free, 1.0)
        optimizer.step()
        losses[iteration] = loss.item()
    wall_s = time.perf_counter() - start
    x, answer = sequences(cfg, cfg.test_sequences, torch.Generator().manual_seed(10**6 + seed))
    with torch.inference_mode():
        right = model(x)[cfg.n_pairs :].argmax(-1) == answer
    trace = model.sequence.trace(x) if isinstance(model, Memory) and seed == 0 else None
    curve = np.array([part.mean() for part in np.array_split(losses, POINTS)])
    accuracy = float(right.double().mean())
    return Learned(accuracy, curve, n_parameters(model), iterations, wall_s, trace)


def _all(cfg: RecallConfig) -> dict[str, list[Learned]]:
    """Every variant from every seed, by `workers` processes."""
    jobs = [(variant, seed) for variant in cfg.variants for seed in range(cfg.seeds)]
    found: dict[tuple[str, int], Learned] = {}
    with progress_bar(len(jobs), "training") as bar:
        if cfg.workers == 1:
            for job in jobs:
                found[job] = learn(cfg, *job)
                bar.update()
        else:
            context = multiprocessing.get_context("spawn")
            with ProcessPoolExecutor(cfg.workers, mp_context=context) as pool:
                waiting = {pool.submit(learn, cfg, *job): job for job in jobs}
                for done in as_completed(waiting):
                    found[waiting[done]] = done.result()
                    bar.update()
    return {v: [found[v, seed] for seed in range(cfg.seeds)] for v in cfg.variants}


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command = command_line("experiments.recall")
    write_text(folder / "config.yaml", OmegaConf.to_yaml(cfg, resolve=True))
    start = time.perf_counter()
    found = _all(plain)
    wall_s = time.perf_counter() - start
    accuracy = {v: np.array([run.accuracy for run in runs]) for v, runs in found.items()}
    rows: list[tuple[object, ...]] = []
    lines = []
    for variant, runs in found.items():
        mean, half = interval(accuracy[variant])
        said = "-"
        if "lstm" in accuracy and variant != "lstm":
            said = verdict(accuracy[variant], accuracy["lstm"], lower_is_better=False)
        size, iterations = runs[0].parameters, runs[0].iterations
        seconds = float(np.mean([run.wall_s for run in runs]))
        rows.append((variant, mean, half, size, iterations, seconds, said))
        lines.append(
            [variant, shown(mean, half, 2), str(size), str(iterations), f"{seconds:.1f}", said]
        )
    header = ("variant", "accuracy", "parameters", "iterations", "training [s]", "against lstm")
    table = markdown(header, lines)
    test = sequences(plain, plain.test_sequences, torch.Generator().manual_seed(10**6))
    keyless = without_keys(test[1])
    note = (
        f"{plain.n_pairs} pairs of {plain.n_keys} keys and {plain.n_values} values; guessing gives "
        f"{1 / plain.n_values:.2f}, always "
        f"answering the value shown most often {keyless:.2f}. Mean and 95 % interval over "
        f"{plain.seeds} seeds."
    )
    figures, traces = {}, {v: runs[0].trace for v, runs in found.items() if runs[0].trace}
    if plain.figures:
        x = {v: np.linspace(0, runs[0].iterations, POINTS) for v, runs in found.items()}
        lines_of = {v: np.mean([run.loss for run in runs], axis=0) for v, runs in found.items()}
        figures["learning"] = curves(lines_of, x, ("iteration", "cross entropy"), "Recall", True)
        if traces:
            members = {v: trace.member(plain.member) for v, trace in traces.items()}
            t = np.arange(2 * plain.n_pairs)
            title = f"Recall, test sequence {plain.member}: shown, then asked for"
            figures["memory"] = mt.memory_figure(members, t, title, [plain.n_pairs - 0.5])
    arrays = {f"{v}/accuracy": values for v, values in accuracy.items()}
    arrays |= {f"{v}/loss": np.stack([run.loss for run in runs]) for v, runs in found.items()}
    record = {
        "accuracy": {v: values.tolist() for v, values in accuracy.items()},
        "table": [dict(zip(HEADER, row, strict=True)) for row in rows],
        "guessing": 1 / plain.n_values,
        "without_keys": keyless,
        "wall_s": wall_s,
        "command": command,
    }
    scalars = {f"{v}/loss": np.mean([run.loss for run in runs], 0) for v, runs in found.items()}
    report = f"`{command}`\n\n{table}\n\n{note}\n"
    arrays |= trace_arrays(traces, plain.member)
    write_all(folder, plain, record, HEADER, rows, report, arrays, figures, scalars)
    print(f"{table}\n\n{note} {wall_s:.0f} s in all\nwritten to {folder}", flush=True)


if __name__ == "__main__":
    main()
