"""Associative recall by backpropagation: the cell beside nn.LSTM and nn.GRU."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("recall")

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
from torch import nn

from mann_torch import memory_figure
from mann_torch.errors import ConfigError

from .command.cli import command_line, reject_unknown, run_cli
from .learning.figures import learning_curves
from .learning.recall_models import (
    LONG,
    Memory,
    build_model,
    n_parameters,
    sequences,
    step_labels,
    without_keys,
)
from .learning.report import (
    Measure,
    Report,
    by_variant,
    compare,
    conclude,
    member_arrays,
)
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .settings.checks import check_between, check_positive, check_variants
from .settings.machine import check_memory, check_workers
from .settings.memory_config import RECALLERS, RecallConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURES = (Measure("accuracy", "accuracy", 2, lower_is_better=False),)
POINTS = 50  # of a learning curve


@dataclass(frozen=True)
class Learned:
    """One training: accuracy on new sequences, the learning curve, what the memory did."""

    accuracy: float
    loss: np.ndarray  # (POINTS,) means over stretches of training
    parameters: int
    iterations: int
    wall_s: float
    trace: dict[str, np.ndarray]  # of test sequence `member`, seed 0; empty without a memory


def main() -> None:
    """Command line of `python -m experiments.recall`."""
    run_cli("recall", checked, _task)


def checked(cfg: Any) -> RecallConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, RecallConfig)
    plain = cast(RecallConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_variants(plain.variants, RECALLERS)
    sizes = ("n_keys", "n_pairs", "n_slots", "hidden_size", "context_size")
    check_between(plain, {**dict.fromkeys(sizes, (1, 1000)), "n_values": (2, 1000)})
    check_between(plain, {"iterations": (POINTS, 10**6), "longer": (1, 1000), "seeds": (1, 1000)})
    check_between(plain, dict.fromkeys(("batch", "test_sequences"), (1, 10**6)))
    check_between(plain, {"member": (0, plain.test_sequences - 1), "seed": (0, 2**31)})
    for name in ("rate", "temperature"):
        check_positive(name, getattr(plain, name))
    if plain.n_pairs > plain.n_keys:
        raise ConfigError(f"n_pairs = {plain.n_pairs}: no key comes twice, n_keys is too small")
    check_workers(plain.workers)
    check_memory("batch, test_sequences and sizes", _bytes_needed(plain))
    return plain


def _bytes_needed(cfg: RecallConfig) -> float:
    """Of float32: inputs of a batch or of all tests, and the memories of every step of a batch."""
    steps, width = 2 * cfg.n_pairs, cfg.n_keys + cfg.n_values + 1
    inputs = max(cfg.batch, cfg.test_sequences) * steps * width
    kept = cfg.batch * steps * cfg.n_slots * cfg.hidden_size
    tested = cfg.test_sequences * cfg.n_slots * cfg.hidden_size
    return 4.0 * min(cfg.workers, len(cfg.variants) * cfg.seeds) * (2 * inputs + max(kept, tested))


def n_iterations(cfg: RecallConfig, variant: str) -> int:
    """Of one training."""
    return cfg.iterations * (cfg.longer if variant.endswith(LONG) else 1)


def learn(
    cfg: RecallConfig,
    variant: str,
    seed: int,
    progress: Callable[[int], object] = lambda n: None,
) -> Learned:
    """Train one model from one seed, then test it; all variants see the same sequences."""
    torch.set_num_threads(1)
    start_seed, generator, test = _draws(cfg, seed)
    torch.manual_seed(start_seed)
    model = build_model(cfg, variant)
    free = [p for p in model.parameters() if p.requires_grad]
    optimizer = torch.optim.Adam(free, lr=cfg.rate)
    iterations = n_iterations(cfg, variant)
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
        progress(1)
    wall_s = time.perf_counter() - start
    x, answer = sequences(cfg, cfg.test_sequences, test)
    with torch.inference_mode():
        right = model(x)[cfg.n_pairs :].argmax(-1) == answer
    trace: dict[str, np.ndarray] = {}
    if isinstance(model, Memory) and seed == 0:
        trace = member_arrays(model.sequence.trace(x), cfg.member)
        trace["right"] = right[:, cfg.member].numpy()
    curve = np.array([part.mean() for part in np.array_split(losses, POINTS)])
    accuracy = float(right.double().mean())
    return Learned(accuracy, curve, n_parameters(model), iterations, wall_s, trace)


def _draws(cfg: RecallConfig, seed: int) -> tuple[int, torch.Generator, torch.Generator]:
    """A seed for the first weights, and generators for training and for test sequences."""
    state = np.random.SeedSequence([cfg.seed, seed]).generate_state(3, np.uint64)
    start, train, test = (int(number >> 1) for number in state)
    return start, torch.Generator().manual_seed(train), torch.Generator().manual_seed(test)


def reported(cfg: RecallConfig, found: Mapping[str, list[Learned]], wall_s: float) -> Report:
    """Table, record and arrays of a run."""
    accuracy = {v: np.array([run.accuracy for run in runs]) for v, runs in found.items()}
    extra: dict[str, dict[str, object]] = {
        "parameters": {v: runs[0].parameters for v, runs in found.items()},
        "iterations": {v: runs[0].iterations for v, runs in found.items()},
        "training [s]": {
            v: round(float(np.mean([run.wall_s for run in runs])), 1) for v, runs in found.items()
        },
        "least": {v: f"{values.min():.2f}" for v, values in accuracy.items()},
        "most": {v: f"{values.max():.2f}" for v, values in accuracy.items()},
    }
    keyless = without_keys(sequences(cfg, cfg.test_sequences, _draws(cfg, 0)[2])[1])
    note = (
        f"{cfg.n_pairs} pairs of {cfg.n_keys} keys and {cfg.n_values} values; guessing gives "
        f"{1 / cfg.n_values:.2f}, always answering the value shown most often {keyless:.2f}. "
        f"Accuracy on {cfg.test_sequences} new sequences: mean and 95 % interval over {cfg.seeds} "
        "seeds, least and most of them. Better, worse: than lstm, paired by seed, at 95 %."
    )
    losses = {v: np.stack([run.loss for run in runs]) for v, runs in found.items()}
    arrays = {
        v: {**runs[0].trace, "accuracy": accuracy[v], "loss": losses[v]}
        for v, runs in found.items()
    }
    baselines = {v: "lstm" for v in found if v != "lstm"}
    return Report(
        compare(MEASURES, {v: {"accuracy": a} for v, a in accuracy.items()}, baselines, extra),
        note,
        {"guessing": 1 / cfg.n_values, "without_keys": keyless, "wall_s": wall_s},
        by_variant(arrays),
        {f"{v}/loss": values.mean(axis=0) for v, values in losses.items()},
        {},
    )


def pictures(cfg: RecallConfig, found: Mapping[str, list[Learned]]) -> dict[str, Figure]:
    """Learning curves, and what each memory did in one sequence."""
    losses = {v: np.stack([run.loss for run in runs]) for v, runs in found.items()}
    iterations = {v: runs[0].iterations for v, runs in found.items()}
    figures = {"learning": learning_curves(losses, iterations, math.log(cfg.n_values))}
    traces = {v: runs[0].trace for v, runs in found.items() if runs[0].trace}
    if traces:
        title = f"Recall, test sequence {cfg.member}: key = value shown, then key? (! wrong)"
        figure = memory_figure(traces, None, title, [cfg.n_pairs - 0.5])
        x = sequences(cfg, cfg.test_sequences, _draws(cfg, 0)[2])[0]
        lower = [ax for ax in figure.axes if ax.get_xlabel()]
        for ax, trace in zip(lower, traces.values(), strict=True):
            labels = step_labels(cfg, x[:, cfg.member], trace["right"])
            ax.set_xticks(range(len(labels)), labels, fontsize="x-small", rotation=90)
        figures["memory"] = figure
    return figures


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    start = time.perf_counter()
    each = [(variant, seed) for variant in plain.variants for seed in range(plain.seeds)]
    ready = all_parts(
        learn,
        {f"{variant}_{seed}": (plain, variant, seed) for variant, seed in each},
        [n_iterations(plain, variant) for variant, _ in each],
        npz_parts(Learned, folder / "finished"),
        plain.workers,
        "iteration",
        20,
    )
    found = {v: [ready[f"{v}_{seed}"] for seed in range(plain.seeds)] for v in plain.variants}
    report = reported(plain, found, time.perf_counter() - start)
    command = command_line("experiments.recall")
    conclude(folder, plain, command, report, lambda: pictures(plain, found))


if __name__ == "__main__":
    main()
