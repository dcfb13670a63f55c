"""Schema of online regression."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import PicturesConfig

LEARNERS = (
    "network",
    "network_matched",
    "soft",
    "hard",
    "reallocating_initial",
    "reallocating_always",
    "readouts",
)


@dataclass
class OnlineRegressionConfig:
    """A stream whose function changes abruptly and comes back, learned sample by sample."""

    variants: list[str] = field(default_factory=list)
    rates: list[float] = field(default_factory=list)  # C_w = C_v: each variant takes its best
    tuning_visits: int = 4  # of each function, on streams of their own, to choose the rate
    n_functions: int = 3  # K
    visits: int = 4  # of each function, in turn
    visit_length: float = 10.0  # [s]
    dt: float = 0.01  # [s] between samples
    n_hidden: int = 10  # N
    n_slots: int = 5  # S
    write_gain: float = 0.75  # c_w
    shift_threshold: float = 0.2  # theta
    recall_time: float = 0.03  # tau [s], of `readouts`
    sharpness: float = 4.0  # beta, of `readouts`
    spread: float = 1.0  # of readouts at first
    common: float = 0.0  # c, of `readouts`
    wiped: bool = False  # whether readouts start anew at each change: what they held is worth that
    initial_std: float = 1.0  # of the inner weights
    window: float = 1.0  # [s] after a switch that count as such
    seeds: int = 20  # streams, functions and initial weights, all at once
    workers: int = 2
    member: int = 0  # whose memory is shown
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None
