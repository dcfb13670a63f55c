"""Schema of `ablation`: the memory less one part each."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import PicturesConfig

TABLES = ("online", "arm", "recall")


@dataclass(frozen=True)
class Slots:
    """A learner or controller: slots of the paper's memory, and slots of readouts; 0: none."""

    memory: int = 0
    readouts: int = 0
    wiped: bool = False  # readouts start anew at each change


_BOTH = {
    "plain": Slots(),
    "memory_1": Slots(memory=1),
    "memory_5": Slots(memory=5),
    **{f"readouts_{count}": Slots(readouts=count) for count in (1, 2, 3, 5, 8)},
}
#: What each row of a table is, by name.
ROWS: dict[str, dict[str, Slots]] = {
    "online": {**_BOTH, "wiped_5": Slots(readouts=5, wiped=True)},
    "arm": {**_BOTH, "memory_1_readouts_5": Slots(memory=1, readouts=5)},
}
#: Cells of `peers` that differ from `memory`, the default, in one thing, and the paper's.
CELLS = ("memory", "no_inertia", "no_clock", "written_where_read", "one_slot", "memory_paper")


@dataclass
class OnlineTableConfig:
    """As `online_regression`, whose other settings are its own."""

    variants: list[str] = field(default_factory=list)
    rates: list[float] = field(default_factory=list)  # each variant takes its best
    visits: int = 4  # of each of 3 functions, in turn
    visit_length: float = 10.0  # [s]
    seeds: int = 20


@dataclass
class ArmTableConfig:
    """The paper's arm and controller; payloads at its end take turns, at random."""

    variants: list[str] = field(default_factory=list)
    n_regimes: int = 3
    visits: int = 6  # of each
    visit_length: float = 10.0  # [s]
    window: float = 1.0  # [s] after a change that count as such
    payload: float = 3.0  # [kg], at most
    rate: float = 10.0  # C_w = C_v
    noise: list[float] = field(default_factory=lambda: [2e-4, 2e-3])  # of angle [rad] and rate
    dt: float = 5e-4  # [s]
    draws: int = 20  # payloads, references, noise and initial weights


@dataclass
class RecallTableConfig:
    """Recall by backpropagation, as in `peers`."""

    variants: list[str] = field(default_factory=list)
    iterations: int = 600  # at most: a cell that is right twice running stops
    rate: float = 0.01  # of Adam
    hidden_size: int = 32
    seeds: int = 5


@dataclass
class AblationConfig:
    """Three tables: what each part of the memory is worth."""

    tables: list[str] = field(default_factory=list)
    recall_time: float = 0.03  # tau [s], of readouts
    online_sharpness: float = 4.0  # beta of readouts: chosen on tuning streams
    arm_sharpness: float = 2.0  # the library's
    online: OnlineTableConfig = field(default_factory=OnlineTableConfig)
    arm: ArmTableConfig = field(default_factory=ArmTableConfig)
    recall: RecallTableConfig = field(default_factory=RecallTableConfig)
    workers: int = 2
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None
