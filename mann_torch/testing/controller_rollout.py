"""A controller in a loop, for a few steps."""

from __future__ import annotations

from functools import partial

import torch

from ..simulation import ClosedLoop, Implicit, Scenario, Trajectory, rollout
from .controller_bench import ControllerBench
from .forms import called
from .functions import apart
from .telling import broken

#: Step [s], how many of them, and of the largest number how far two engines may be apart.
DT, STEPS, ENGINES_APART = 2e-3, 5, 1e-10


def check_rollout(b: ControllerBench, engine: str) -> None:
    """Raise `InterfaceError` where a short rollout fails, or the engines do not agree."""
    c = b.controller
    run = called(c, 3, f"a rollout of {STEPS} steps", partial(_run, b, engine))
    if bool((run.status != 0).any()):
        told = f"a rollout of {STEPS} steps diverges ({run.solver}, {DT} s)"
        raise broken(c, 3, told, "give a plant and a reference that it can control")
    if run.engine != "compiled":
        return
    other = _run(b, "torch")
    if apart([run.output], [other.output]) > ENGINES_APART:
        raise broken(
            c,
            3,
            "compiled, it gives other numbers than in torch",
            "what it reads must be arguments, constants or buffers: nothing kept in Python",
        )


def _run(b: ControllerBench, engine: str) -> Trajectory:
    loop = ClosedLoop(b.plant, b.controller, model=b.model)
    scenario = Scenario(b.signal, b.plant.parameters_of(), STEPS * DT)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        return rollout(
            loop,
            scenario,
            Implicit(DT),
            generator=generator,
            batch_shape=(2,),
            engine=engine,
        )
