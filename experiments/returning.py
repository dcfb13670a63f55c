"""Regimes of wing rock that return: the plain law, concurrent learning, and the paper's memory."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("returning")

import math
import time
from pathlib import Path
from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError
from mann_torch.plants import WingRock
from mann_torch.tuning import Coordinates

from .command.cli import command_line, reject_unknown, run_cli
from .learning.report import conclude
from .returns.report import picture, reported
from .returns.ways import Found, built, run_way, steps_of
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .settings.checks import check_between, check_positive, check_variants
from .settings.machine import check_memory, check_workers
from .settings.returning_config import ReturningConfig, WayConfig

MOST_STEPS = 1_000_000


def main() -> None:
    """Command line of `python -m experiments.returning`."""
    run_cli("returning", checked, _task)


def checked(cfg: Any) -> ReturningConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, ReturningConfig)
    plain = cast(ReturningConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_variants(plain.variants, tuple(plain.ways))
    plain.ways = {name: _way(name, node) for name, node in plain.ways.items()}
    check_between(plain, {"n_regimes": (2, 100), "visits": (2, 100)})
    check_between(plain, {"draws": (2, 10_000), "training": (1, 1000), "iterations": (1, 10_000)})
    check_between(plain, {"seed": (0, 2**20)})
    for name in ("visit_length", "window"):
        check_positive(name, getattr(plain, name))
    if not plain.window <= plain.visit_length:
        raise ConfigError(f"window = {plain.window}: at most visit_length = {plain.visit_length}")
    for name, wide in (("spread", 6), ("noise", 2)):
        rows = getattr(plain, name)
        if len(rows) != wide:
            raise ConfigError(f"{name} = {rows}: give {wide} numbers")
        for value in rows:
            number(name, value, NONNEGATIVE)
    check_workers(plain.workers)
    for variant in plain.variants:
        made = built(plain, variant)
        if not isinstance(made.loop.plant, WingRock) or not made.loop.plant.accelerometer:
            raise ConfigError(f"variant '{variant}': give wing_rock with accelerometer=true")
        if plain.ways[variant].tuned:
            Coordinates(made.loop, plain.ways[variant].tuned)
        steps = plain.n_regimes * plain.visits * plain.visit_length / made.solver.dt
        if not steps <= MOST_STEPS or plain.window < 8 * made.solver.dt:
            raise ConfigError(
                f"visits of {plain.visit_length} s with solver.dt = {made.solver.dt}: at most "
                f"{MOST_STEPS} steps, and 8 in a window"
            )
        check_memory("draws and visits", math.ceil(200 * steps * plain.draws * plain.workers))
    return plain


def _way(name: str, node: Any) -> WayConfig:
    """A way as its schema has it. Raises `ConfigError`."""
    try:
        merged = OmegaConf.merge(OmegaConf.structured(WayConfig), node)
        return cast(WayConfig, OmegaConf.to_object(merged))
    except (OmegaConfBaseException, ValueError, TypeError) as error:
        raise ConfigError(f"ways.{name} = {node}: {str(error).splitlines()[0]}") from None


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    start = time.perf_counter()
    found = all_parts(
        run_way,
        {name: (plain, name) for name in plain.variants},
        [steps_of(plain, name) for name in plain.variants],
        npz_parts(Found, folder / "finished"),
        plain.workers,
        "step",
        1,
    )
    report = reported(plain, found, time.perf_counter() - start)
    command = command_line("returning")
    conclude(folder, plain, command, report, lambda: {"returns": picture(plain, found)})


if __name__ == "__main__":
    main()
