"""Whether the library works where it is installed: small checks of every layer, by name."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping

import torch

from ..control import AdaptiveLaw, ConstantGain, MannController
from ..deployment import deploy
from ..errors import KernelError
from ..memory import (
    ATTENTIONS,
    HardAttention,
    MemoryCell,
    MemorySequence,
    ReallocatingAttention,
    WorkingMemory,
)
from ..metrics import srmse
from ..plants import PLANTS, TwoLinkArm, arm_parameters
from ..signals import Sinusoid
from ..simulation import ClosedLoop, Scenario, rollout
from ..types import Measurement
from ..version import __version__
from .attentions import check_attention
from .laws import check_law
from .plants import check_plant
from .references import check_reference

#: How far the engines may be apart after 25 steps, and their gradients, relative.
APART, GRADIENTS_APART = 1e-12, 1e-9


def _paper() -> tuple[ClosedLoop, Scenario]:
    memory = WorkingMemory(5, 10, ReallocatingAttention("initial"))
    loop = ClosedLoop(TwoLinkArm(), MannController(2, 10, memory))
    return loop, Scenario(Sinusoid([1.0, 0.0], 0.5), arm_parameters(), horizon=0.1)


def check_plants() -> str:
    """Plants of the library that need no arguments keep their contract."""
    names = [name for name in PLANTS if name not in ("linear", "regression")]
    for name in names:
        check_plant(PLANTS[name]())
    return ", ".join(names)


def check_parts() -> str:
    """So do attentions, a law and a reference."""
    for kind in ATTENTIONS.values():
        check_attention(kind())
    check_law(AdaptiveLaw(ConstantGain(2.0)))
    check_reference(Sinusoid([1.0, 0.5], [0.3, 0.2]))
    return ", ".join([*ATTENTIONS, "constant gain", "sinusoid"])


def check_engines() -> str:
    """A rollout and its gradient compile, and are those of eager torch."""
    loop, scenario = _paper()
    (gain,) = loop.tune("write_gain")
    found = {}
    for engine in ("compiled", "torch"):
        weights = torch.Generator().manual_seed(0)
        run = rollout(loop, scenario, generator=weights, batch_shape=(2,), engine=engine)
        (slope,) = torch.autograd.grad(srmse(run).mean(), gain)
        found[engine] = run.output.detach(), slope
    (output, slope), (judge, by_torch) = found["compiled"], found["torch"]
    apart = float((output - judge).abs().max())
    off = abs(float(slope / by_torch) - 1.0)
    if not (apart <= APART and off <= GRADIENTS_APART and float(by_torch) != 0.0):
        raise KernelError(f"the engines are {apart:.1e} apart, their gradients {off:.1e}")
    return f"{apart:.0e} rad apart, gradients {off:.0e}"


def check_memory() -> str:
    """A sequence of the memory compiles, and is its cell's steps."""
    generator = torch.Generator().manual_seed(0)
    cell = MemoryCell(3, 8, 2, attention=HardAttention(), dtype=torch.float64)
    x = torch.randn(6, 4, 3, generator=generator, dtype=torch.float64)
    with torch.no_grad():
        outputs, _ = MemorySequence(cell, engine="compiled")(x)
        state, steps = None, []
        for row in x:
            output, state = cell(row, state)
            steps.append(output)
    apart = float((outputs - torch.stack(steps)).abs().max())
    if not apart <= APART:
        raise KernelError(f"a sequence is {apart:.1e} from its cell's steps")
    return f"{apart:.0e} apart"


def check_deployed() -> str:
    """A controller leaves the simulator as one step."""
    loop, scenario = _paper()
    stepper = deploy(loop.controller, period=1e-3)
    sample = scenario.reference(torch.tensor(0.0, dtype=torch.float64))
    seen = Measurement(sample.value - 0.01, sample.rate)
    command, _, flags = stepper.step(stepper.initial_state(sample, seen), sample, seen)
    if flags or not bool(torch.isfinite(command).all()):
        raise KernelError(f"a deployed step gives {command.tolist()} with flags {flags}")
    return f"{command.shape[-1]} commands"


CHECKS: Mapping[str, Callable[[], str]] = {
    "plants": check_plants,
    "parts": check_parts,
    "engines": check_engines,
    "memory": check_memory,
    "deployment": check_deployed,
}


def where() -> str:
    """The library, and what it stands on."""
    cuda = torch.cuda.get_device_name() if torch.cuda.is_available() else "no CUDA device"
    return (
        f"mann_torch {__version__}, Python {platform.python_version()}, torch {torch.__version__}, "
        f"{os.cpu_count()} cores, {cuda}"
    )


def run(tell: Callable[[str], object], checks: Mapping[str, Callable[[], str]] = CHECKS) -> int:
    """Run every check and `tell` a line of each; how many failed."""
    failed = 0
    tell(where())
    for name, check in checks.items():
        begun = time.perf_counter()
        try:
            found = f"ok      {check()}"
        except Exception as error:  # whatever goes wrong here is what is to be told
            failed += 1
            lines = str(error).strip().splitlines() or [""]
            found = f"FAILED  {type(error).__name__}: {lines[0]}"
        tell(f"{name:<11}{time.perf_counter() - begun:5.1f} s  {found}")
    return failed
