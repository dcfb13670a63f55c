"""Schemas of studies of the design constants: gradient reports and tuning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .config import LoopConfig, PicturesConfig, ScenarioConfig, ScenarioLoopConfig


@dataclass
class StudyConfig(LoopConfig):
    """What constants are judged on; the base of `tune` and `gradient_report`."""

    output: PicturesConfig = field(default_factory=PicturesConfig)
    effort_after: float = 10.0  # [s] peak inputs count from here on


@dataclass
class SetConfig:
    """Scenarios times draws of the initial weights."""

    scenarios: list[str] = field(default_factory=list)
    draws: list[int] = field(default_factory=list)


@dataclass
class ObjectiveConfig:
    """`mann_torch.tuning.Objective`; limits are multiples of the start's."""

    effort_weight: float = 0.0
    rate_limit: float | None = 0.82
    peak_limit: float | None = 1.01
    saturation: float | None = None  # [N m]
    penalty: float = 20.0


@dataclass
class GradientConfig:
    """`mann_torch.tuning.GradientSettings`."""

    mode: str = "smoothed"
    spread: float = 0.126
    pairs: int | None = None  # null: 3, or by joint what the number of constants asks for
    design: str = "joint"
    control: list[str] = field(default_factory=list)
    step: float = 0.1
    temperature: float = 0.02
    final_temperature: float = 0.002


@dataclass
class ScheduleConfig:
    """`mann_torch.tuning.Schedule`."""

    iterations: int = 60
    optimizer: str = "adam"
    rate: float = 0.15
    minibatch: int | None = None
    curriculum: list[Any] = field(default_factory=list)  # [iteration, horizon in s] pairs


@dataclass
class TuneConfig(StudyConfig):
    """Constants to tune, on what, how, and on what they are judged afterwards."""

    names: list[str] = field(default_factory=list)  # constants to tune
    scenario: ScenarioConfig | None = None  # in place of those that train and held_out name
    start: Any = None  # values to start from, by name; what is not given is each scenario's own
    restart: int = 0  # 0: begin there; 1, 2, ...: at a random point about it, by seed and number
    restart_spread: float = 1.0  # a random point is each constant times a factor in 1/2 to 2
    matrix_form: str = "scalar"
    train: SetConfig = field(default_factory=SetConfig)
    held_out: SetConfig = field(default_factory=SetConfig)
    objective: ObjectiveConfig = field(default_factory=ObjectiveConfig)
    gradient: GradientConfig = field(default_factory=GradientConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    judge: bool = True  # whether to compute the held-out judgement
    grid: Any = None  # lists of numbers by constant: the Pareto grid
    compare: list[str] = field(default_factory=list)  # constants.json files to judge, too
    resume: str | None = None  # folder of a run to go on with


@dataclass
class GradientReportConfig(StudyConfig, ScenarioLoopConfig):
    """Every gradient mode against differences, constant by constant."""

    draws: int = 10
    of_output: int = 1  # number of the output whose SRMSE is differentiated; 0 for all together
    names: list[str] = field(default_factory=list)  # constants to differentiate by
    steps: list[float] = field(default_factory=list)  # relative steps of the differences
    judge: float = 0.1  # the step that the verdicts go by
    spread: float = 0.126
    pairs: int = 3
    control: list[str] = field(default_factory=list)  # whose plain gradient helps `smoothed`
    temperatures: list[float] = field(default_factory=list)
    horizons: list[float] = field(default_factory=list)  # [s] of the norms
