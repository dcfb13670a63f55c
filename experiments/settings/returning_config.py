"""Schema of `returning`: regimes of wing rock that come back."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .config import PicturesConfig


@dataclass
class WayConfig:
    """A controller: settings beside the shared ones, and constants that are tuned first."""

    overrides: list[str] = field(default_factory=list)
    tuned: list[str] = field(default_factory=list)


@dataclass
class ReturningConfig:
    """Wing-rock regimes in turn, each for a visit, over and over."""

    variants: list[str] = field(default_factory=list)  # which of `ways`; the first is the baseline
    shared: list[str] = field(default_factory=list)  # settings of all, as `simulate` takes them
    ways: dict[str, Any] = field(default_factory=dict)  # each a `WayConfig`
    n_regimes: int = 2
    visits: int = 4  # of each regime, in turn
    visit_length: float = 10.0  # [s]
    window: float = 2.0  # [s] after a change that count as such
    spread: list[float] = field(default_factory=lambda: [2.0, 1.0, 1.0, 1.0, 0.3, 0.3])
    noise: list[float] = field(default_factory=lambda: [0.002, 0.02])  # of angle and rate
    draws: int = 20  # regimes, references and noise, all at once
    training: int = 8  # draws of their own to tune on
    iterations: int = 40
    workers: int = 2
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None
