"""How a rollout is differentiated: the names, and what each asks for."""

from __future__ import annotations

from ..checks import choice, instance
from ..errors import ConfigError
from ..functional import Numbers, as_float64
from .closed_loop import ClosedLoop
from .solvers.implicit import Implicit
from .solvers.solver import Solver

#: ``plain``: autograd through the steps; decisions fall on step ends and have no gradient.
#: ``hybrid``: isolated switches and resets are located inside their step and differentiated through
#: their time, see `events/steps.hybrid_step`.
#: ``soft``: the relaxed controller of a temperature instead, in which nothing switches, see
#: `memory.relaxed`.
GRADIENTS = ("plain", "hybrid", "soft")


def check_gradient(
    gradient: str,
    solver: Solver,
    temperature: Numbers | None = None,
    loop: ClosedLoop | None = None,
) -> None:
    """Raise `ConfigError` for an unknown name, or what it cannot have or lacks; `KindError`."""
    choice("gradient", gradient, GRADIENTS)
    instance("solver", solver, Solver)
    if temperature is not None:
        as_float64(temperature, "temperature")
    if (temperature is not None) != (gradient == "soft"):
        raise ConfigError(f"gradient = '{gradient}': temperature belongs to 'soft', which needs it")
    if gradient == "hybrid" and type(solver) is not Implicit:
        raise ConfigError(
            f"gradient = 'hybrid': events are located in steps of the implicit solver, not of "
            f"{solver.name}"
        )
    if loop is None or not locates_events(gradient, instance("loop", loop, ClosedLoop)):
        return
    if loop.samples or loop.controller.periods:
        raise ConfigError(
            "gradient = 'hybrid': with a clock or a sensor that samples, or a law that does, "
            "decisions fall on ticks, without a time of their own: take 'plain'"
        )


def locates_events(gradient: str, loop: ClosedLoop) -> bool:
    """Whether steps are hybrid; for a controller that never switches, hybrid is plain."""
    return gradient == "hybrid" and bool(loop.controller.switches)
