"""Differentiable adaptive controllers with working memory."""

from .control import Controller, MannController, equal_parameter_hidden
from .errors import (
    ConfigError,
    DomainError,
    DtypeError,
    KernelError,
    MannError,
    ShapeError,
    SolverError,
    WeightsFileError,
)
from .memory import (
    Attention,
    HardAttention,
    KeyRule,
    ReallocatingAttention,
    RepresentationKeys,
    SoftAttention,
    StateKeys,
    WorkingMemory,
)
from .metrics import peak_torque, reallocations, srmse, switches, torque_rate
from .plants import ArmParameters, Plant, TwoLinkArm, arm_parameters
from .signals import MeasurementNoise, PiecewiseConstant, Reference, Sinusoid
from .simulation import (
    ClosedLoop,
    Implicit,
    Odeint,
    Scenario,
    Solver,
    Status,
    Trajectory,
    observe,
    rollout,
)
from .types import NetworkState, PlantState

__all__ = [
    "ArmParameters",
    "Attention",
    "ClosedLoop",
    "ConfigError",
    "Controller",
    "DomainError",
    "DtypeError",
    "HardAttention",
    "Implicit",
    "KernelError",
    "KeyRule",
    "MannController",
    "MannError",
    "MeasurementNoise",
    "NetworkState",
    "Odeint",
    "PiecewiseConstant",
    "Plant",
    "PlantState",
    "ReallocatingAttention",
    "Reference",
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
    "observe",
    "peak_torque",
    "reallocations",
    "rollout",
    "srmse",
    "switches",
    "torque_rate",
]
