"""Schemas of the configuration files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING


@dataclass
class PlantConfig:
    name: str = MISSING
    masses: list[float] = MISSING
    lengths: list[float] = MISSING
    viscous: list[float] = MISSING
    coulomb: list[float] = MISSING
    gravity: float = MISSING


@dataclass
class KeysConfig:
    name: str = MISSING


@dataclass
class ControllerConfig:
    name: str = MISSING
    attention: str | None = None
    phase: str = "initial"
    n_hidden: int | None = 10
    matched_hidden: int = 10


@dataclass
class MemoryConfig:
    n_slots: int = 5
    reset: str = "scaled"


@dataclass
class ConstantsConfig:
    """Design constants by name; the paper's symbols are in the README's table."""

    write_gain: float = 0.75  # c_w
    shift_threshold: float = 0.2  # theta
    key_rate: float = 1.0  # c_k [1/s]
    error_gain: Any = 5.0  # Lambda [1/s]: number, n diagonal entries or n x n rows
    base_gain: float = 20.0  # K_v [N m s/rad]
    robust_gain: float = 10.0  # k_v
    weight_bound: float = 0.0  # Z_m
    rate_W: float = 10.0  # noqa: N815 - C_w
    rate_V: float = 10.0  # noqa: N815 - C_v
    e_modification: float = 0.0  # kappa


@dataclass
class MassGrowthConfig:
    """m^2 -> m^2 + increment m(0)^2 every period; no growth where neither is given."""

    increment: float | None = None
    period: float | None = None  # [s]


@dataclass
class ScenarioConfig:
    name: str = MISSING
    amplitude: list[float] = MISSING
    frequency: list[float] = MISSING
    offset: list[float] = MISSING
    horizon: float = MISSING
    mass_jumps: list[Any] = field(default_factory=list)
    # A node from the start: OmegaConf can't put a mapping where a structured node is null.
    mass_growth: MassGrowthConfig | None = field(default_factory=MassGrowthConfig)
    q: list[float] = field(default_factory=lambda: [0.0, 0.0])
    qd: list[float] = field(default_factory=lambda: [0.0, 0.0])


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
class OutputConfig(PicturesConfig):
    sample_dt: float = 0.05
    member: int = 0  # whose pictures: 0 to draws - 1


@dataclass
class LoopConfig:
    """One scenario under one controller: what `simulate` and `ensemble` are told alike."""

    plant: PlantConfig = field(default_factory=PlantConfig)
    keys: KeysConfig = field(default_factory=KeysConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    memory: MemoryConfig = field(default_factory=MemoryConfig)
    constants: ConstantsConfig = field(default_factory=ConstantsConfig)
    scenario: ScenarioConfig = field(default_factory=ScenarioConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    initial: InitialConfig = field(default_factory=InitialConfig)
    horizon: float | None = None  # [s], the scenario's own if null
    seed: int = 0
    run_dir: str | None = None


@dataclass
class SimulateConfig(LoopConfig):
    output: OutputConfig = field(default_factory=OutputConfig)
    draws: int = 1


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
