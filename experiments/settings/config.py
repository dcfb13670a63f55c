"""Schemas of the configuration files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

#: What a run is of where nothing is said.
PAPERS_PLANT = "two_link_arm"


@dataclass
class KeysConfig:
    name: str = MISSING


@dataclass
class MannConfig:
    """What `controller` says of the paper's kind; another kind has its constructor's arguments."""

    name: str = MISSING
    kind: str = "mann"
    attention: str | None = None
    phase: str = "initial"
    n_hidden: int | None = 10
    matched_hidden: int = 10


@dataclass
class MemoryConfig:
    n_slots: int = 5
    reset: str = "scaled"


@dataclass
class ScenarioConfig:
    """What is asked of a plant. `schedule` and `start` are told by the plant's own names."""

    name: str = MISSING
    horizon: float = MISSING  # [s]
    reference: Any = None  # unless one is chosen: name and arguments
    schedule: Any = None  # changes of the plant's parameters, by name
    start: Any = None  # rows of the plant's state, by name; at rest where not given


@dataclass
class SolverConfig:
    name: str = MISSING
    dt: float = 5e-3  # [s] for torchdiffeq's methods; conf/solver/implicit.yaml has its own
    rtol: float = 1e-5
    atol: float = 1e-8
    max_step: float | None = None
    follow_reference: bool = True  # implicit only: more accurate, see its docstring
    engine: str = "auto"  # compiled, torch, or auto: compiled where the loop's step can be compiled
    device: str = "cpu"  # of the compiled engine: cpu or cuda
    compile: bool = False  # torch engine only


@dataclass
class InitialConfig:
    """Initial inner weights: a file's draws, or normal ones of standard deviation `std`."""

    weights_file: str | None = None
    draw: int = 0
    std: float = 0.1


@dataclass
class PicturesConfig:
    """What a command shows of its results, beside tables and arrays."""

    figures: bool = True
    format: Any = "png"  # of the pictures: png, pdf, svg, or a list of them
    dpi: float = 110.0
    tensorboard: bool = True


@dataclass
class FilmedConfig(PicturesConfig):
    animation: Any = False  # of the mechanism: true (a GIF), gif, or mp4, which takes ffmpeg


@dataclass
class OutputConfig(FilmedConfig):
    sample_dt: float = 0.05
    member: int = 0  # whose pictures: 0 to draws - 1


#: What studies of the paper's controller look at.
PAPERS_NAMES = (
    *("write_gain", "shift_threshold", "error_gain", "base_gain", "robust_gain"),
    *("rate_W", "rate_V"),
)


@dataclass
class ProblemConfig:
    """A problem with known answers: what it is called, and what studies ask of it.

    Without one, it is what they ask of the paper's controller.
    """

    name: str | None = None
    #: Constants to tune or to differentiate by.
    names: list[str] = field(default_factory=lambda: list(PAPERS_NAMES))
    effort_after: float = 10.0  # [s]


@dataclass
class LoopConfig:
    """What a loop is made of, how it is solved, and where results go: what all studies are told.

    Open nodes hold a `name` and arguments of what it names; they are checked against its class.
    None of them: there is no such part.
    """

    problem: ProblemConfig = field(default_factory=ProblemConfig)
    plant: dict[str, Any] = field(default_factory=dict)
    reference: Any = None  # in place of the scenario's own
    controller: dict[str, Any] = field(default_factory=dict)
    network: Any = None  # in place of the paper's
    law: Any = None  # of the network
    keys: KeysConfig = field(default_factory=KeysConfig)
    memory: MemoryConfig = field(default_factory=MemoryConfig)
    constants: dict[str, Any] = field(default_factory=dict)  # of whatever part declares them
    actuator: Any = None
    sensor: Any = None
    clock: Any = None
    model: Any = None  # reference model
    disturbance: Any = None
    solver: SolverConfig = field(default_factory=SolverConfig)
    initial: InitialConfig = field(default_factory=InitialConfig)
    horizon: float | None = None  # [s], the scenario's own if null
    seed: int = 0
    run_dir: str | None = None


@dataclass
class ScenarioLoopConfig(LoopConfig):
    """One scenario of one loop."""

    scenario: ScenarioConfig = field(default_factory=ScenarioConfig)


@dataclass
class SimulateConfig(ScenarioLoopConfig):
    output: OutputConfig = field(default_factory=OutputConfig)
    draws: int = 1


def title_of(cfg: ScenarioLoopConfig) -> str:
    """What a run is of, in a few words."""
    controller, plant = cfg.controller["name"], cfg.plant["name"]
    words = [f"scenario {cfg.scenario.name}", controller]
    if plant != PAPERS_PLANT:
        words.insert(1, plant)
    if cfg.controller.get("attention") is not None:
        words.append(f"{cfg.keys.name} keys")
    return ", ".join(map(str, words))


#: Nodes whose keys are told by what they name, not by a schema.
OPEN = (
    *("plant", "reference", "controller", "network", "law", "constants"),
    *("actuator", "sensor", "clock", "model", "disturbance"),
    *("scenario.reference", "scenario.schedule", "scenario.start", "spread"),
)


@dataclass
class GoldenConfig:
    """Numbers of an independent simulator to check against (`srmse.json` beside the weights)."""

    srmse_file: str | None = None


@dataclass
class RowConfig:
    """One line of a table: a controller variant, in the table's scenario unless it names one."""

    variant: str = MISSING
    label: str = MISSING
    scenario: str | None = None
    paper: list[float] | None = None  # SRMSE x 10^3 of joints 1 and 2, as published


@dataclass
class TableConfig:
    title: str = MISSING
    scenario: str = "1"
    metric: str = "srmse"  # or srmse_after_10s
    rows: list[RowConfig] = field(default_factory=list)
    # Labels of two rows, from I to II, and the reduction the paper prints [%].
    reduction: list[str] | None = None
    paper_reduction: list[float] | None = None


@dataclass
class FigureConfig:
    title: str = MISSING
    scenario: str = "illustration"
    variants: list[str] = field(default_factory=list)
    panels: list[str] = field(default_factory=list)


@dataclass
class ReproduceConfig:
    solver: SolverConfig = field(default_factory=SolverConfig)
    initial: InitialConfig = field(default_factory=InitialConfig)
    golden: GoldenConfig = field(default_factory=GoldenConfig)
    output: PicturesConfig = field(default_factory=PicturesConfig)
    variants: dict[str, list[str]] = field(default_factory=dict)
    tables: dict[str, TableConfig] = field(default_factory=dict)
    figures: dict[str, FigureConfig] = field(default_factory=dict)
    claims: bool = False
    horizon: float | None = None  # [s], cuts every scenario short; for trials
    draws: int = 3
    seed: int = 0
    workers: int = 2
    run_dir: str | None = None
