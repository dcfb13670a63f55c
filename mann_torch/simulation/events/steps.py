"""Steps that stop at events: a switch of branch or a reset, differentiated through its time."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from ...compiled.events.rules import TIE
from ...functional import one_hot, pick
from ...types import MemoryMode, Proximity
from .roots import derivative, first_root, slope_at


class EventCounts(NamedTuple):
    """What a hybrid rollout met, a count a sample (...,) int64."""

    located: Tensor  # isolated events, differentiated through their time
    sliding: Tensor  # steps in which two slots chatter: averaged
    unresolved: Tensor  # steps that end past an event: taken at the next step's start, untimed


def no_events(batch: torch.Size) -> EventCounts:
    """Nothing met yet."""
    return EventCounts(*(torch.zeros(batch, dtype=torch.int64) for _ in range(3)))


class Branched(Protocol):
    """A flow with S branches that switches between them and resets itself.

    t, h (...,) [s], state y (..., M), weights (..., S) of the branches, one-hot or a mixture.
    """

    def flow(self, t: Tensor, h: Tensor, y: Tensor, weights: Tensor, mode: MemoryMode) -> Tensor:
        """y(t + h), smooth in h on both sides of 0."""

    def proximity(self, t: Tensor, y: Tensor, mode: MemoryMode) -> Proximity:
        """How near each branch is, and how far a reset is overdue."""

    def reset(
        self, t: Tensor, y: Tensor, mode: MemoryMode, due: Tensor
    ) -> tuple[Tensor, MemoryMode]:
        """State and mode (but for `attended`) after a reset of the samples `due` (...,) bool."""


def hybrid_step(
    system: Branched, t: Tensor, h: Tensor, y: Tensor, mode: MemoryMode
) -> tuple[Tensor, MemoryMode, EventCounts]:
    """Jump at t, then flow to t + h with each sample's first event inside the step located.

    With A = flow(y, e_s, h) under the attended branch s, and an event function g < 0 before, > 0
    at A (a nearer branch j: D_s - D_j; a reset: min R - theta):

    - isolated: the root tau* of g is found without gradient; one Newton correction
      tau = tau* - g(flow(y, e_s, tau*)) / (dg/dtau), the slope held constant, leaves its value and
      gives it its gradient (there by an exact slope, else by differences). The step is
      flow(event(flow(y, e_s, tau)), e_j, h - tau).
    - chattering: branch j alone, D = flow(y, e_j, h), drives g back. No event time exists; the
      step is flow(y, alpha e_s + (1 - alpha) e_j, h) with alpha = -g(D) / (g(A) - g(D)), which
      ends on g = 0 up to h^2: the averaged (Filippov) motion, with its gradient.
      Where three slots chatter, two are averaged and the third is left pending.
    - grazing, or a second event in the same step: what is pending at t + h is taken by the jump
      there, as in a plain step.

    An event counts as past at t only beyond `TIE`: one that rounding puts on either side of a step
    end is located in the next step at tau = 0, not lost.
    """
    t, h = t.expand(y.shape[:-1]), h.expand(y.shape[:-1])
    y, mode = jump(system, t, y, mode)
    s, size = mode.attended, mode.active.shape[-1]
    held = _branch(s, size)
    end = system.flow(t, h, y, held, mode)
    before = _events(system, t, y, mode).detach()
    after = _events(system, t + h, end, mode).detach()
    crossed = (before <= TIE) & (after > 0) & torch.isfinite(after)
    none = torch.zeros_like(s, dtype=torch.bool)
    if not bool(crossed.any()):
        return end, mode, _counts(none, none, (after > TIE).any(dim=-1))
    result, slid, partner = end, none, s
    single = crossed.any(dim=-1) & ~crossed[..., size]
    if bool(single.any()):
        nearest = torch.where(crossed, after, -torch.inf).argmax(dim=-1)
        partner = torch.where(single, nearest, s)
        other = system.flow(t, h, y, _branch(partner, size), mode)
        back = _event(system, t + h, other, mode, partner)
        slid = single & (back.detach() < _at(before, partner))
        if bool(slid.any()):
            forth = _event(system, t + h, end, mode, partner)
            alpha = torch.where(slid, -back, 0.5) / torch.where(slid, forth - back, 1.0)
            share = alpha.unsqueeze(-1)
            mixture = share * held + (1.0 - share) * _branch(partner, size)
            result = pick(slid, system.flow(t, h, y, mixture, mode), result)
    crossed = crossed & ~slid.unsqueeze(-1)
    isolated = none
    if bool(crossed.any()):

        def probe(tau: Tensor) -> Tensor:
            with torch.no_grad():
                state = system.flow(t, tau, y.detach(), held, mode)
                return _events(system, t + tau, state, mode).detach()

        root, which = first_root(probe, h, crossed, before, after)
        slope, steep = slope_at(probe, root, which, h, crossed, before, after)
        isolated = crossed.any(dim=-1) & steep
        root = torch.where(isolated, root, 0.5 * h)
        which = torch.where(isolated, which, s)
        there = system.flow(t, root, y, held, mode)
        value = torch.where(isolated, _event(system, t + root, there, mode, which), 0.0)
        tau = root - value.detach() / torch.where(isolated, slope, 1.0)
        if torch.is_grad_enabled():

            def along(time: Tensor) -> Tensor:
                state = system.flow(t, time, y.detach(), held, mode)
                return _event(system, t + time, state, mode, which)

            exact = torch.where(isolated, derivative(along, root), 1.0)
            tau = tau - (value - value.detach()) / exact
            # Once more, from where tau depends on y already: second derivatives are right too.
            there = system.flow(t, tau, y, held, mode)
            left = torch.where(isolated, _event(system, t + tau, there, mode, which), 0.0)
            tau = tau - (left - left.detach()) / exact
        at = system.flow(t, tau, y, held, mode)
        at, mode = _happen(system, t + tau, at, mode, which, isolated)
        rest = system.flow(t + tau, h - tau, at, _branch(mode.attended, size), mode)
        result = pick(isolated, rest, result)
    pending = _events(system, t + h, result, mode).detach() > TIE
    # While two slots chatter, a switch between them is not pending.
    pair = one_hot(partner, size + 1) & slid.unsqueeze(-1)
    return result, mode, _counts(isolated, slid, (pending & ~pair).any(dim=-1))


def jump(system: Branched, t: Tensor, y: Tensor, mode: MemoryMode) -> tuple[Tensor, MemoryMode]:
    """What is past its threshold at t by more than `TIE` happens now, without a time."""
    due = system.proximity(t, y, mode).margin.detach() >= TIE
    if bool(due.any()):
        y, mode = system.reset(t, y, mode, due)
    return y, _attend(system, t, y, mode)


def _attend(system: Branched, t: Tensor, y: Tensor, mode: MemoryMode) -> MemoryMode:
    """The nearest branch is attended; one within `TIE` of it goes on."""
    distances = system.proximity(t, y, mode).distances.detach()
    nearest = distances.argmin(dim=-1)
    known = mode.attended >= 0
    now = _at(distances, mode.attended.clamp(min=0))
    keep = known & (now - _at(distances, nearest) <= TIE)
    return _attending(mode, torch.where(keep, mode.attended, nearest))


def _attending(mode: MemoryMode, attended: Tensor) -> MemoryMode:
    switched = (attended != mode.attended) & (mode.attended >= 0)
    return mode._replace(attended=attended, switches=mode.switches + switched)


def _happen(
    system: Branched, t: Tensor, y: Tensor, mode: MemoryMode, which: Tensor, isolated: Tensor
) -> tuple[Tensor, MemoryMode]:
    """Event number `which` (...,) of the samples `isolated`: a switch, or (number S) a reset."""
    resets = isolated & (which == mode.active.shape[-1])
    switched = _attending(mode, torch.where(isolated & ~resets, which, mode.attended))
    if not bool(resets.any()):
        return y, switched
    y, mode = system.reset(t, y, switched, resets)
    retaken = _attend(system, t, y, mode)
    attended = torch.where(resets, retaken.attended, mode.attended)
    return y, _attending(mode, attended)


def _events(system: Branched, t: Tensor, y: Tensor, mode: MemoryMode) -> Tensor:
    """Event functions (..., S + 1): D_s - D_j for each j, -inf for s, then the reset's margin."""
    distances, margin = system.proximity(t, y, mode)
    gaps = _at(distances, mode.attended).unsqueeze(-1) - distances
    own = one_hot(mode.attended, distances.shape[-1])
    gaps = torch.where(own, -torch.inf, gaps)
    return torch.cat([gaps, margin.unsqueeze(-1)], dim=-1)


def _event(system: Branched, t: Tensor, y: Tensor, mode: MemoryMode, which: Tensor) -> Tensor:
    """The event function number `which` (...,), differentiable."""
    return _at(_events(system, t, y, mode), which)


def _at(values: Tensor, index: Tensor) -> Tensor:
    """Entry `index` (...,) of values (..., E)."""
    return values.gather(-1, index.unsqueeze(-1)).squeeze(-1)


def _branch(index: Tensor, size: int) -> Tensor:
    """e_i (..., S)."""
    return one_hot(index, size).to(torch.float64)


def _counts(located: Tensor, sliding: Tensor, unresolved: Tensor) -> EventCounts:
    return EventCounts(*(flag.to(torch.int64) for flag in (located, sliding, unresolved)))
