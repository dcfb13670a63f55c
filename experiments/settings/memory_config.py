"""Schemas of the two learning experiments with the memory: online regression and recall."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import PicturesConfig

#: Variants of the two experiments.
LEARNERS = (
    "network",
    "network_matched",
    "soft",
    "hard",
    "reallocating_initial",
    "reallocating_always",
    "network_fixed",
    "readouts",
)
RECALLERS = ("soft", "hard", "relaxed", "reallocating", "lstm", "gru", "lstm_long", "gru_long")


@dataclass
class OnlineRegressionConfig:
    """A stream whose function changes abruptly and comes back, learned sample by sample."""

    variants: list[str] = field(default_factory=list)
    rates: list[float] = field(default_factory=list)  # C_w = C_v: each variant takes its best
    tuning_visits: int = 2  # of each function, on streams of their own, to choose the rate
    n_functions: int = 3  # K
    visits: int = 4  # of each function, in turn
    visit_length: float = 10.0  # [s]
    dt: float = 0.01  # [s] between samples
    n_hidden: int = 10  # N
    n_slots: int = 5  # S
    write_gain: float = 0.75  # c_w
    shift_threshold: float = 0.2  # theta
    key_rate: float = 1.0  # c_k [1/s], of `readouts`
    initial_std: float = 1.0  # of the inner weights
    window: float = 1.0  # [s] after a switch that count as such
    seeds: int = 20  # streams, functions and initial weights, all at once
    workers: int = 2
    member: int = 0  # whose memory is shown
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None


@dataclass
class RecallConfig:
    """Associative recall trained by backpropagation, at equal parameter count."""

    variants: list[str] = field(default_factory=list)
    n_keys: int = 8
    n_values: int = 8
    n_pairs: int = 6  # shown, then all of them asked for
    n_slots: int = 8  # S
    hidden_size: int = 16  # N of the cell; the others get as many parameters
    context_size: int = 4  # width of the cell's keys
    iterations: int = 300
    longer: int = 5  # times the iterations, for lstm_long and gru_long
    batch: int = 64
    rate: float = 0.02  # of Adam, the same for all
    temperature: float = 0.5  # of relaxed attention
    test_sequences: int = 2000
    seeds: int = 5
    workers: int = 2
    member: int = 0  # whose memory is shown
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None
