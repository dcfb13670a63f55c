"""All discrete decisions of a loop at one instant: of its sensor, its clock, its controller."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..control import Controller
from ..control.sampling import moved
from ..functional import pick
from ..parts import Clock
from ..trees import map_tensors
from ..types import LoopMode, LoopState, ReferenceSample
from .closed_loop import ClosedLoop
from .conditions import Conditions


def jump(
    loop: ClosedLoop, t: Tensor, state: LoopState, mode: LoopMode, here: Conditions
) -> tuple[LoopState, LoopMode]:
    """State and mode after the decisions at time t [s].

    The sensor takes its sample, then the controller decides: at any step's start, or at its clock's
    ticks, where it adapts before and commands after.
    """
    outside = here.within(t)
    if loop.sensor is not None and mode.sensor is not None and here.ticks is not None:
        flat = torch.cat(list(loop.seen(state, here, outside.forces)), dim=-1)
        sampled = loop.sensor(flat, mode.sensor)
        mode = mode._replace(sensor=_at_tick(here.ticks.sensor, sampled, mode.sensor))
    ticks = True if loop.clock is None or here.ticks is None else here.ticks.clock
    if ticks is False:
        return state, mode
    sample = loop.followed(outside, state, here)
    seen = loop.measured(state, mode, here, outside.forces)
    if loop.clock is None:
        return _decided(loop.controller, sample, seen, state, mode)
    now, then = _ticked(loop.controller, loop.clock, t, sample, seen, state, mode)
    return _at_tick(ticks, now, state), _at_tick(ticks, then, mode)


def _decided(
    controller: Controller, sample: ReferenceSample, seen: Any, state: LoopState, mode: LoopMode
) -> tuple[LoopState, LoopMode]:
    """The controller's own jump."""
    if mode.controller is None:
        return state, mode
    own, inner = controller.jump(sample, seen, state.controller, mode.controller)
    return state._replace(controller=own), mode._replace(controller=inner)


def _ticked(
    controller: Controller,
    clock: Clock,
    t: Tensor,
    sample: ReferenceSample,
    seen: Any,
    state: LoopState,
    mode: LoopMode,
) -> tuple[LoopState, LoopMode]:
    """The controller adapts over the period, decides and commands: see `Clock`."""
    held = mode.clock
    if held is None:
        return state, mode
    own = moved(
        controller, clock.elapsed(held), sample, seen, state.controller, mode.controller,
        held.rates, held.decay,
    )  # fmt: skip
    state = state._replace(controller=own)
    state, mode = _decided(controller, sample, seen, state, mode)
    output = controller(sample, seen, state.controller, mode.controller)
    return state, mode._replace(clock=clock.ticked(t, held, output))


def _at_tick(tick: Tensor | bool, new: Any, old: Any) -> Any:
    """The new tree at a tick, else the old one."""
    if isinstance(tick, bool):
        return new if tick else old
    return map_tensors(lambda a, b: pick(tick, a, b), new, old)
