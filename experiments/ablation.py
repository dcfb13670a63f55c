"""What each part of the memory is worth: online regression, an arm, recall."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("ablation")

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError

from .ablating import arm, online, recall
from .ablating.part import Part
from .ablating.report import picture, reported
from .command.cli import command_line, reject_unknown, run_cli
from .learning.report import conclude
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .settings.ablation_config import CELLS, ROWS, TABLES, AblationConfig
from .settings.checks import check_between, check_positive, check_variants
from .settings.machine import check_memory, check_workers

MOST_STEPS = 5_000_000


def main() -> None:
    """Command line of `python -m experiments.ablation`."""
    run_cli("ablation", checked, _task)


def checked(cfg: Any) -> AblationConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, AblationConfig)
    plain = cast(AblationConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_variants(plain.tables, TABLES, "table")
    for name in ("recall_time", "online_sharpness", "arm_sharpness"):
        check_positive(name, getattr(plain, name))
    check_between(plain, {"seed": (0, 2**20)})
    check_workers(plain.workers)
    _check_online(plain)
    _check_arm(plain)
    own = plain.recall
    check_variants(own.variants, CELLS)
    check_between(own, {"iterations": (1, 10**6), "hidden_size": (1, 1000)}, "recall.")
    check_between(own, {"seeds": (1, 1000)}, "recall.")
    check_positive("recall.rate", own.rate)
    return plain


def _check_online(cfg: AblationConfig) -> None:
    """Raise `ConfigError` for what can't be."""
    own = cfg.online
    check_variants(own.variants, tuple(ROWS["online"]))
    check_between(own, {"visits": (2, 1000), "seeds": (1, 10_000)}, "online.")
    if not own.rates or len(set(own.rates)) < len(own.rates):
        raise ConfigError(f"online.rates = {own.rates}: name each once, at least one")
    for rate in own.rates:
        check_positive("online.rates", rate)
    check_positive("online.visit_length", own.visit_length)
    if not 2.0 <= own.visit_length <= 1e4:
        raise ConfigError(f"online.visit_length = {own.visit_length}: 2 to 1e4 s")
    steps = 300 * own.visits * own.visit_length
    check_memory("online.seeds and visits", math.ceil(16 * own.seeds * steps * cfg.workers))


def _check_arm(cfg: AblationConfig) -> None:
    """Raise `ConfigError` for what can't be."""
    own = cfg.arm
    check_variants(own.variants, tuple(ROWS["arm"]))
    check_between(own, {"n_regimes": (2, 20), "visits": (2, 1000), "draws": (2, 10_000)}, "arm.")
    for name in ("visit_length", "window", "payload", "rate", "dt"):
        check_positive(f"arm.{name}", getattr(own, name))
    if len(own.noise) != 2:
        raise ConfigError(f"arm.noise = {own.noise}: give 2 numbers, of angle and rate")
    for value in own.noise:
        number("arm.noise", value, NONNEGATIVE)
    if not own.window <= own.visit_length or own.window < 8 * own.dt:
        raise ConfigError(f"arm.window = {own.window}: 8 dt or more, at most visit_length")
    steps = own.n_regimes * own.visits * own.visit_length / own.dt
    if not steps <= MOST_STEPS:
        raise ConfigError(f"arm.visits, visit_length and dt ask for over {MOST_STEPS:.0e} steps")
    check_memory("arm.draws and visits", math.ceil(200 * steps * own.draws * cfg.workers))


def row(cfg: AblationConfig, table: str, variant: str, progress: Callable[[int], object]) -> Part:
    """One variant of one table."""
    return {"online": online, "arm": arm, "recall": recall}[table].run(cfg, variant, progress)


def count(cfg: AblationConfig, table: str, variant: str) -> int:
    """How often `row` reports progress."""
    if table == "online":
        return online.count(cfg, variant)
    return 1 if table == "arm" else cfg.recall.seeds


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    start = time.perf_counter()
    each = [(table, v) for table in plain.tables for v in getattr(plain, table).variants]
    ready = all_parts(
        row,
        {"_".join(one): (plain, *one) for one in each},
        [count(plain, *one) for one in each],
        npz_parts(Part, folder / "finished"),
        plain.workers,
        "piece",
        1,
    )
    found = {
        table: {v: ready[f"{table}_{v}"] for t, v in each if t == table} for table in plain.tables
    }
    report = reported(plain, found, time.perf_counter() - start)
    command = command_line("ablation")
    conclude(folder, plain, command, report, lambda: {"ablation": picture(found)})


if __name__ == "__main__":
    main()
