"""Closed loops, solvers and rollouts: where plants, controllers and signals meet."""

from .closed_loop import ClosedLoop, Observation
from .events.steps import EventCounts
from .explaining import Explanation, explain
from .gradients import GRADIENTS, check_gradient
from .observation import attended_slot, observe
from .rollout import ENGINES, check_engine, rollout
from .scenario import Scenario
from .solvers.implicit import Implicit
from .solvers.odeint import ADAPTIVE, FIXED, METHODS, Odeint
from .solvers.solver import Flow, Solver
from .task import Effort
from .trajectory import Motion, Outcome, Status, Trajectory

#: Names a configuration may use.
SOLVERS: tuple[str, ...] = ("implicit", *METHODS)

__all__ = [
    "ADAPTIVE",
    "ENGINES",
    "FIXED",
    "GRADIENTS",
    "METHODS",
    "SOLVERS",
    "ClosedLoop",
    "Effort",
    "EventCounts",
    "Explanation",
    "Flow",
    "Implicit",
    "Motion",
    "Observation",
    "Odeint",
    "Outcome",
    "Scenario",
    "Solver",
    "Status",
    "Trajectory",
    "attended_slot",
    "check_engine",
    "check_gradient",
    "explain",
    "observe",
    "rollout",
]
