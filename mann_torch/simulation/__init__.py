"""Closed loops, solvers and rollouts: where plants, controllers and signals meet."""

from .closed_loop import ClosedLoop
from .events import EventCounts
from .gradients import GRADIENTS, check_gradient
from .implicit import Implicit
from .observation import attended_slot, observe
from .odeint import METHODS, Odeint
from .rollout import ENGINES, check_engine, rollout
from .scenario import Scenario
from .solver import Flow, Solver
from .task import Effort
from .trajectory import Motion, Outcome, Status, Trajectory

#: Names a configuration may use.
SOLVERS: tuple[str, ...] = ("implicit", *METHODS)

__all__ = [
    "ENGINES",
    "GRADIENTS",
    "METHODS",
    "SOLVERS",
    "ClosedLoop",
    "Effort",
    "EventCounts",
    "Flow",
    "Implicit",
    "Motion",
    "Odeint",
    "Outcome",
    "Scenario",
    "Solver",
    "Status",
    "Trajectory",
    "attended_slot",
    "check_engine",
    "check_gradient",
    "observe",
    "rollout",
]
