"""Every public constructor and function with arguments that are right, all of them given."""

from __future__ import annotations

from tests.public_calls import (
    of_control,
    of_deployment,
    of_laws,
    of_loop,
    of_memory,
    of_mrac,
    of_parts,
    of_plants,
    of_signals,
    of_simulation,
    of_simulators,
    of_tracking,
    of_tuning,
)
from tests.public_calls.things import Call

#: What can be called with arguments, by its public name.
CALLS: dict[str, Call] = {
    **of_control.CALLS,
    **of_deployment.CALLS,
    **of_laws.CALLS,
    **of_loop.CALLS,
    **of_memory.CALLS,
    **of_mrac.CALLS,
    **of_parts.CALLS,
    **of_plants.CALLS,
    **of_signals.CALLS,
    **of_simulation.CALLS,
    **of_simulators.CALLS,
    **of_tracking.CALLS,
    **of_tuning.CALLS,
}
