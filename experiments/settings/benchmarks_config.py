"""Schema of `benchmarks`: which problems with known answers, and how they are run."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import FilmedConfig

#: Problems with known answers, in the order of their tables.
BENCHMARKS = (
    *("quadrotor", "rohrs", "slotine_li", "wing_rock", "estimators"),
    *("scalar_mrac", "limited_input", "l1"),
)
ENGINES = ("compiled", "torch")


@dataclass
class BenchmarksConfig:
    """Problems by name; `overrides` are settings of `simulate` that come after a case's own."""

    problems: list[str] = field(default_factory=list)
    engine: str = "compiled"  # or torch
    halved: bool = True  # whether every case is run at half its step too, for the spread
    overrides: list[str] = field(default_factory=list)  # to see what a wrong constant does
    output: FilmedConfig = field(default_factory=FilmedConfig)
    workers: int = 2
    run_dir: str | None = None
