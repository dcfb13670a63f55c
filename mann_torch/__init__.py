"""Differentiable adaptive controllers with working memory.

Names are imported when they are first used: `import mann_torch.memory` loads the memory alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .control import Controller, MannController, equal_parameter_hidden
    from .errors import (
        ConfigError,
        DomainError,
        DtypeError,
        KernelError,
        KindError,
        MannError,
        RecordError,
        ShapeError,
        SolverError,
        WeightsFileError,
    )
    from .figures import memory_figure
    from .memory import (
        Attention,
        CellState,
        HardAttention,
        KeyRule,
        MemoryCell,
        MemorySequence,
        ReallocatingAttention,
        RelaxedAttention,
        RepresentationKeys,
        SoftAttention,
        StateKeys,
        WorkingMemory,
        relaxed,
    )
    from .metrics import input_rate, peak_input, reallocations, srmse, switches
    from .plants import ArmParameters, Plant, TwoLinkArm, arm_parameters
    from .signals import MeasurementNoise, PiecewiseConstant, Reference, Sinusoid
    from .simulation import (
        ClosedLoop,
        Implicit,
        Motion,
        Odeint,
        Outcome,
        Scenario,
        Solver,
        Status,
        Trajectory,
        explain,
        observe,
        rollout,
    )
    from .types import NetworkState, PlantState

__all__ = [
    "ArmParameters",
    "Attention",
    "CellState",
    "ClosedLoop",
    "ConfigError",
    "Controller",
    "DomainError",
    "DtypeError",
    "HardAttention",
    "Implicit",
    "KernelError",
    "KeyRule",
    "KindError",
    "MannController",
    "MannError",
    "MeasurementNoise",
    "MemoryCell",
    "MemorySequence",
    "Motion",
    "NetworkState",
    "Odeint",
    "Outcome",
    "PiecewiseConstant",
    "Plant",
    "PlantState",
    "ReallocatingAttention",
    "RecordError",
    "Reference",
    "RelaxedAttention",
    "RepresentationKeys",
    "Scenario",
    "ShapeError",
    "Sinusoid",
    "SoftAttention",
    "Solver",
    "SolverError",
    "StateKeys",
    "Status",
    "Trajectory",
    "TwoLinkArm",
    "WeightsFileError",
    "WorkingMemory",
    "arm_parameters",
    "equal_parameter_hidden",
    "explain",
    "input_rate",
    "memory_figure",
    "observe",
    "peak_input",
    "reallocations",
    "relaxed",
    "rollout",
    "srmse",
    "switches",
]

#: Where names are looked for, in this order: lower layers load no higher ones.
_PARTS = (
    "errors",
    "types",
    "memory",
    "control",
    "plants",
    "signals",
    "simulation",
    "metrics",
    "figures",
)


def __getattr__(name: str) -> Any:
    if name in __all__:
        for part in _PARTS:
            module = import_module(f"{__name__}.{part}")
            if hasattr(module, name):
                value = globals()[name] = getattr(module, name)
                return value
    if name in (*_PARTS, "checks", "constraints", "functional", "statistics", "trees", "tuning"):
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
