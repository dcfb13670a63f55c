"""Schema of `peers`: the memory beside other sequence models."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import PicturesConfig

TASKS = ("recall", "copy", "gap", "returning")
PEERS = ("lstm", "gru", "attention", "titans", "memory", "memory_paper")


@dataclass
class TaskConfig:
    """What every task has."""

    iterations: int = 400
    batch: int = 32


@dataclass
class RecallConfig(TaskConfig):
    """Pairs of a key and a value, then keys alone."""

    n_keys: int = 8
    n_values: int = 8
    n_pairs: int = 6  # shown, then all of them asked for


@dataclass
class CopyConfig(TaskConfig):
    """Symbols, blanks, then the symbols again."""

    n_symbols: int = 8
    length: int = 5  # symbols to be copied
    gap: int = 50  # blanks


@dataclass
class GapConfig(TaskConfig):
    """Which symbol came first?"""

    n_classes: int = 4
    shortest: int = 10  # steps
    longest: int = 100


@dataclass
class ReturningTaskConfig(TaskConfig):
    """Regression under returning changes."""

    n_functions: int = 3  # K, new ones for every sequence
    n_waves: int = 1  # J of f(x) = sum_j c_j sin(1.5 j x + phase_j)
    steps: int = 60
    shortest: int = 6  # steps of a visit
    longest: int = 14
    window: int = 4  # steps after the first of a return that are judged


@dataclass
class PeersConfig:
    """Sequence models of equal parameter count on the same sequences."""

    variants: list[str] = field(default_factory=list)
    tasks: list[str] = field(default_factory=list)
    rates: dict[str, float] = field(default_factory=dict)  # of Adam, by variant
    shares: dict[str, float] = field(default_factory=dict)  # times a task's iterations; else 1
    hidden_size: int = 32  # N of `memory`; the others get as many parameters
    n_slots: int = 8  # S
    every: int = 20  # iterations from one evaluation to the next
    evaluated: int = 200  # sequences of an evaluation on the way
    tested: int = 1000  # new sequences at the end
    seeds: int = 5
    workers: int = 2
    recall: RecallConfig = field(default_factory=RecallConfig)
    copy: CopyConfig = field(default_factory=CopyConfig)
    gap: GapConfig = field(default_factory=GapConfig)
    returning: ReturningTaskConfig = field(default_factory=ReturningTaskConfig)
    member: int = 0  # the test sequence whose memory is shown
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None
