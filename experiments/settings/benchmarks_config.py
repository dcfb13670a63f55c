"""Schema of `benchmarks`: which problems with known answers, and how they are run."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import PicturesConfig


@dataclass
class BenchmarksConfig:
    """Problems by name; `overrides` are settings of `simulate` that come after a case's own."""

    problems: list[str] = field(default_factory=list)
    engine: str = "compiled"  # or torch
    halved: bool = True  # whether every case is run at half its step too, for the spread
    overrides: list[str] = field(default_factory=list)  # to see what a wrong constant does
    output: PicturesConfig = field(default_factory=PicturesConfig)
    workers: int = 2
    run_dir: str | None = None
