"""Differentiable adaptive controllers with working memory.

Names are imported when they are first used: `import mann_torch.memory` loads the memory alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .version import __version__ as __version__

if TYPE_CHECKING:
    from .control import (
        AdaptiveNetwork,
        Controller,
        FeatureNetwork,
        LinearFeedback,
        MannController,
        NetworkInputs,
        equal_parameter_hidden,
    )
    from .deployment import Stepper, deploy
    from .errors import (
        ConfigError,
        DomainError,
        DtypeError,
        ExportError,
        InterfaceError,
        KernelError,
        KindError,
        MannError,
        RecordError,
        ReferenceFileError,
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
        MemoryLayers,
        MemorySequence,
        MemoryStream,
        ReallocatingAttention,
        RelaxedAttention,
        RepresentationKeys,
        SoftAttention,
        StateKeys,
        WorkingMemory,
        relaxed,
    )
    from .metrics import input_rate, peak_input, reallocations, srmse, switches
    from .parts import Actuator, Clock, LinearModel, ReferenceModel, SecondOrderModel, Sensor
    from .plants import ArmParameters, MechanicalPlant, Plant, TwoLinkArm, arm_parameters
    from .signals import Disturbance, MeasurementNoise, PiecewiseConstant, Reference, Sinusoid
    from .simulation import (
        ClosedLoop,
        Implicit,
        Motion,
        Observation,
        Odeint,
        Outcome,
        RungeKutta,
        Scenario,
        Solver,
        Status,
        Trajectory,
        explain,
        observe,
        rollout,
    )
    from .types import Channel, ControlOutput, NetworkState, PlantState, ReferenceSample

__all__ = [
    "Actuator",
    "AdaptiveNetwork",
    "ArmParameters",
    "Attention",
    "CellState",
    "Channel",
    "Clock",
    "ClosedLoop",
    "ConfigError",
    "ControlOutput",
    "Controller",
    "Disturbance",
    "DomainError",
    "DtypeError",
    "ExportError",
    "FeatureNetwork",
    "HardAttention",
    "Implicit",
    "InterfaceError",
    "KernelError",
    "KeyRule",
    "KindError",
    "LinearFeedback",
    "LinearModel",
    "MannController",
    "MannError",
    "MeasurementNoise",
    "MechanicalPlant",
    "MemoryCell",
    "MemoryLayers",
    "MemorySequence",
    "MemoryStream",
    "Motion",
    "NetworkInputs",
    "NetworkState",
    "Observation",
    "Odeint",
    "Outcome",
    "PiecewiseConstant",
    "Plant",
    "PlantState",
    "ReallocatingAttention",
    "RecordError",
    "Reference",
    "ReferenceFileError",
    "ReferenceModel",
    "ReferenceSample",
    "RelaxedAttention",
    "RepresentationKeys",
    "RungeKutta",
    "Scenario",
    "SecondOrderModel",
    "Sensor",
    "ShapeError",
    "Sinusoid",
    "SoftAttention",
    "Solver",
    "SolverError",
    "StateKeys",
    "Status",
    "Stepper",
    "Trajectory",
    "TwoLinkArm",
    "WeightsFileError",
    "WorkingMemory",
    "arm_parameters",
    "deploy",
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
    "parts",
    "simulation",
    "deployment",
    "metrics",
    "figures",
)

_OTHERS = (
    "checks",
    "constraints",
    "domains",
    "functional",
    "interface",
    "simulators",
    "statistics",
    "stiff",
    "testing",
    "trees",
    "tuning",
)


def __getattr__(name: str) -> Any:
    if name in __all__:
        for part in _PARTS:
            module = import_module(f"{__name__}.{part}")
            if hasattr(module, name):
                value = globals()[name] = getattr(module, name)
                return value
    if name in (*_PARTS, *_OTHERS):
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
