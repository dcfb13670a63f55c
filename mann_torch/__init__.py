"""Differentiable adaptive controllers with working memory."""

from .control import Controller, MannController, equal_parameter_hidden
from .errors import ConfigError, DomainError, MannError, ShapeError, SolverError, WeightsFileError
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
from .metrics import reallocations, srmse, switches
from .plants import ArmParameters, Plant, TwoLinkArm, arm_parameters
from .signals import PiecewiseConstant, Reference, Sinusoid
from .simulation import (
    ClosedLoop,
    Implicit,
    Odeint,
    Scenario,
    Solver,
    Status,
    Trajectory,
    rollout,
)

__all__ = [
    "ArmParameters",
    "Attention",
    "ClosedLoop",
    "ConfigError",
    "Controller",
    "DomainError",
    "HardAttention",
    "Implicit",
    "KeyRule",
    "MannController",
    "MannError",
    "Odeint",
    "PiecewiseConstant",
    "Plant",
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
    "reallocations",
    "rollout",
    "srmse",
    "switches",
]
