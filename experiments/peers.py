"""The memory beside LSTM, GRU, attention and titans on sequence tasks, by backpropagation."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("peers")

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch import memory_figure
from mann_torch.errors import ConfigError

from .command.cli import command_line, reject_unknown, run_cli
from .learning.report import conclude
from .peering import titans
from .peering.figures import learning_curves
from .peering.report import Found, reported
from .peering.training import Learned, learn, n_iterations, test_sequences
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .sequence_tasks.every import TASKS
from .settings.checks import check_between, check_positive, check_variants
from .settings.machine import check_memory, check_workers
from .settings.peers_config import PEERS, PeersConfig, TaskConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_STEPS = 10_000  # of a sequence


def main() -> None:
    """Command line of `python -m experiments.peers`."""
    run_cli("peers", checked, _task)


def checked(cfg: Any) -> PeersConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, PeersConfig)
    plain = cast(PeersConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_variants(plain.variants, PEERS)
    check_variants(plain.tasks, tuple(TASKS), "task")
    check_between(plain, dict.fromkeys(("n_slots", "hidden_size"), (1, 1000)))
    check_between(plain, dict.fromkeys(("every", "evaluated", "tested"), (1, 10**6)))
    check_between(plain, {"seeds": (1, 1000), "seed": (0, 2**31), "member": (0, plain.tested - 1)})
    for variant in plain.variants:
        if variant not in plain.rates:
            raise ConfigError(f"rates: none for {variant}")
    for name in ("rates", "shares"):
        for variant, value in getattr(plain, name).items():
            check_variants([variant], PEERS)
            check_positive(f"{name}.{variant}", value)
    _check_tasks(plain)
    check_workers(plain.workers)
    for task in plain.tasks:
        check_memory(f"{task}.batch, tested and sizes", _bytes_needed(plain, task))
    return plain


def _check_tasks(cfg: PeersConfig) -> None:
    """Raise `ConfigError` for a size of a task that can't be."""
    for name in TASKS:
        both = {"iterations": (1, 10**6), "batch": (1, 10**6)}
        check_between(getattr(cfg, name), both, f"{name}.")
    recall, copy, gap, back = cfg.recall, cfg.copy, cfg.gap, cfg.returning
    check_between(recall, {"n_keys": (1, 1000), "n_values": (2, 1000)}, "recall.")
    check_between(recall, {"n_pairs": (1, recall.n_keys)}, "recall.")  # no key comes twice
    sizes = {"n_symbols": (2, 1000), "length": (1, 1000), "gap": (0, MOST_STEPS)}
    check_between(copy, sizes, "copy.")
    check_between(gap, {"n_classes": (2, 1000), "longest": (1, MOST_STEPS)}, "gap.")
    check_between(gap, {"shortest": (1, gap.longest)}, "gap.")
    check_between(back, {"n_functions": (2, 1000), "n_waves": (1, 100)}, "returning.")
    check_between(back, {"longest": (2, MOST_STEPS), "steps": (1, MOST_STEPS)}, "returning.")
    check_between(back, {"shortest": (2, back.longest)}, "returning.")
    check_between(back, {"window": (1, back.shortest - 1)}, "returning.")
    if back.steps < back.n_functions * back.longest + 2:
        raise ConfigError(
            f"returning.steps = {back.steps}: n_functions * longest + 2 or more, so that every "
            "sequence has a return"
        )


def _bytes_needed(cfg: PeersConfig, name: str) -> float:
    """Of float32: inputs and features of what is drawn at once, the memories of a batch's steps."""
    settings: TaskConfig = getattr(cfg, name)
    steps = {
        "recall": 2 * cfg.recall.n_pairs,
        "copy": 2 * cfg.copy.length + cfg.copy.gap,
        "gap": cfg.gap.longest,
        "returning": cfg.returning.steps,
    }[name]
    drawn = max(settings.batch * min(cfg.every, settings.iterations), cfg.tested, cfg.evaluated)
    inputs = drawn * steps * (2 * TASKS[name](cfg).n_inputs + cfg.hidden_size)
    kept = settings.batch * steps * cfg.n_slots * cfg.hidden_size
    return 4.0 * min(cfg.workers, len(cfg.variants) * cfg.seeds) * (inputs + kept)


def pictures(cfg: PeersConfig, found: Found) -> dict[str, Figure]:
    """Scores on the way, and what each memory did in one sequence of each task."""
    figures = {"learning": learning_curves(cfg, found)}
    for name, runs in found.items():
        traces = {v: each[0].trace for v, each in runs.items() if each[0].trace}
        if not traces:
            continue
        figure = memory_figure(traces, None, f"{name}, test sequence {cfg.member}", [])
        labels = TASKS[name](cfg).labels(test_sequences(cfg, name), cfg.member)
        for ax in (ax for ax in figure.axes if ax.get_xlabel()):
            marked = [(step, text) for step, text in enumerate(labels) if text]
            ax.set_xticks(
                [step for step, _ in marked],
                [text for _, text in marked],
                fontsize="x-small",
                rotation=90,
            )
        figures[f"memory_{name}"] = figure
    return figures


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    start = time.perf_counter()
    missing = {}
    if "titans" in plain.variants and not titans.is_installed():
        missing["titans"] = "titans-pytorch is not installed"
    there = [variant for variant in plain.variants if variant not in missing]
    seeds = range(plain.seeds)
    each = [(task, variant, seed) for task in plain.tasks for variant in there for seed in seeds]
    ready = all_parts(
        learn,
        {"_".join(map(str, one)): (plain, *one) for one in each},
        [n_iterations(plain, task, variant) for task, variant, _ in each],
        npz_parts(Learned, folder / "finished"),
        plain.workers,
        "iteration",
        20,
    )
    found = {
        task: {v: [ready[f"{task}_{v}_{seed}"] for seed in seeds] for v in there}
        for task in plain.tasks
    }
    report = reported(plain, found, missing, time.perf_counter() - start)
    command = command_line("peers")
    conclude(folder, plain, command, report, lambda: pictures(plain, found))


if __name__ == "__main__":
    main()
