"""Schema of `tune_problems`: benchmark problems tuned by gradient."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import PicturesConfig

TUNED_PROBLEMS = ("quadrotor", "rohrs")


@dataclass
class ProblemTuningConfig:
    """Which problems, members to learn from, members to be judged on."""

    problems: list[str] = field(default_factory=list)
    train: int = 16  # members to learn from
    train_horizon: float = 5.0  # [s]
    held_out: int = 200  # members to be judged on
    iterations: int = 80
    rate: float = 0.1  # of Adam, in coordinates
    effort_limit: float = 1.0  # RMS input, a multiple of the start's, member by member
    noise: list[float] = field(default_factory=lambda: [0.0, 0.0])  # quadrotor: of q and qd
    workers: int = 2
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None
