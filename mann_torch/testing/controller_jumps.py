"""A controller's decisions: jumps, what decides them, and resets."""

from __future__ import annotations

from typing import Any

import torch

from ..trees import difference, leaves
from ..types import MemoryMode, Proximity
from .controller_bench import Asked, ControllerBench
from .forms import called
from .functions import ROUNDING, SAMPLES, apart, check_function, tried_of
from .telling import broken

LINE = 6


def check_jumps(b: ControllerBench, asked: Asked) -> None:
    """Raise `InterfaceError` where decisions are no function, or do not settle."""
    c = b.controller
    found = called(c, LINE, "jump of a batch", lambda: c.jump(*asked))
    if not (isinstance(found, tuple) and len(found) == 2):
        raise broken(c, LINE, f"jump gives a {type(found).__name__}", "return state and mode")
    for name, now, before in zip(("state", "mode"), found, (asked.state, asked.mode), strict=True):
        told = difference(now, before)
        if told is not None:
            mend = "a jump changes numbers, not kinds, shapes or dtypes"
            raise broken(c, LINE, f"the {name} after a jump is not like it: {told}", mend)
    state, mode = found
    if not c.reallocates and _moved(state, asked.state):
        told = "jump changes the state, though it does not say `reallocates`"
        raise broken(c, LINE, told, "set `reallocates = True`, or change the mode alone")
    if leaves(found):
        check_function(tried_of(c, LINE, "jump", _jump, asked))
    again = c.jump(asked.reference, asked.measurement, state, mode)
    if apart(leaves(again), leaves(found)) > ROUNDING:
        raise broken(
            c,
            LINE,
            "a second jump at the same instant changes something",
            "decide from reference, measurement and state, and count only what changes",
        )
    if c.switches:
        _check_switching(b, asked._replace(state=state, mode=mode))


def _jump(controller: Any, asked: Asked) -> Any:
    return controller.jump(*asked)


def _moved(one: Any, other: Any) -> bool:
    return not all(map(torch.equal, leaves(one), leaves(other)))


def _check_switching(b: ControllerBench, asked: Asked) -> None:
    """What locates events asks for more."""
    c = b.controller
    if not isinstance(asked.mode, MemoryMode):
        told = f"it `switches`, and its mode is a {type(asked.mode).__name__}"
        raise broken(c, LINE, told, "events are located in a MemoryMode")
    found = called(c, LINE, "proximity", lambda: c.proximity(*asked))
    slots = asked.mode.active.shape[-1]
    if not isinstance(found, Proximity):
        raise broken(c, LINE, f"proximity gives a {type(found).__name__}", "return a Proximity")
    shapes = {"distances": (SAMPLES, slots), "margin": (SAMPLES,)}
    for name, shape in shapes.items():
        value = getattr(found, name)
        if tuple(value.shape) != shape or value.dtype != torch.float64:
            told = f"{name} of proximity is {value.dtype} {tuple(value.shape)}"
            raise broken(c, LINE, told, f"give float64 {shape}: (..., S) and (...,)")
    never = torch.zeros(SAMPLES, dtype=torch.bool)
    kept = called(c, LINE, "reallocate", lambda: c.reallocate(*asked, never))
    if _moved(kept, (asked.state, asked.mode)):
        told = "reallocate changes samples in which no reset is due"
        raise broken(c, LINE, told, "torch.where(due, new, old), for each leaf")
