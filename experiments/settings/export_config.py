"""Schema of `export`: a controller that leaves the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import ScenarioLoopConfig

RUNTIMES = ("c", "torch_export", "aoti", "onnx")
PRECISIONS = ("float64", "float32")
CONSTANTS = ("baked", "struct")


@dataclass
class ExportedConfig:
    """How the controller is written."""

    period: float | None = None  # [s] between steps; the clock's, without a clock 1e-3
    dtype: str = "float64"  # or float32
    runtimes: list[str] = field(default_factory=lambda: ["c"])  # c, torch_export, aoti, onnx
    name: str = "controller"  # of files and functions
    constants: str = "baked"  # in C: numbers of the text, or a struct that can be set
    libm: bool = True  # whether the C may call <math.h>
    tuned: str | None = None  # constants.json of a run of tune, or its folder
    learned: bool = False  # whether a state goes along that has run through the scenario


@dataclass
class ExportConfig(ScenarioLoopConfig):
    """The loop as `simulate` has it, and what becomes of its controller."""

    export: ExportedConfig = field(default_factory=ExportedConfig)
