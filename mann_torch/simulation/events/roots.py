"""First root of the largest event function in a step, and its slope there; no gradients."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from ...compiled import transformed
from ...compiled.events.rules import FLAT, GRAZE, ITERATIONS, ROUNDING, STENCIL, WIDTH

Probe = Callable[[Tensor], Tensor]  # fractions of the step (...,) [s] -> event functions (..., E)


def first_root(
    probe: Probe, h: Tensor, crossed: Tensor, before: Tensor, after: Tensor
) -> tuple[Tensor, Tensor]:
    """Root tau (...,) in [0, h] of the largest of the events `crossed` (..., E), and its number.

    `before`, `after` (..., E) are their values at 0 and h. Illinois' rule: the secant of a bracket,
    the value of an end that stays put halved. A sample that is done waits for its batch mates.
    """
    low, high = torch.zeros_like(h), h
    f_low, f_high = _largest(before, crossed), _largest(after, crossed)
    limit = (WIDTH * (f_high - f_low)).clamp(min=ROUNDING)
    at_start = f_low >= 0  # rounding put the event on the step's start
    root = torch.where(at_start, low, high)
    done = at_start | ~crossed.any(dim=-1)
    side = torch.zeros_like(h)
    for _ in range(ITERATIONS):
        if bool(done.all()):
            break
        x = torch.where(done, root, high - f_high * (high - low) / (f_high - f_low))
        f = _largest(probe(x), crossed)
        above = f > 0
        f_low = torch.where(above, torch.where(side > 0, 0.5 * f_low, f_low), f)
        f_high = torch.where(above, f, torch.where(side < 0, 0.5 * f_high, f_high))
        low, high = torch.where(above, low, x), torch.where(above, x, high)
        side = torch.where(above, 1.0, -1.0)
        root = x
        done = done | (f.abs() <= limit) | (high - low <= WIDTH * h)
    return root, torch.where(crossed, probe(root), -torch.inf).argmax(dim=-1)


def slope_at(
    probe: Probe,
    root: Tensor,
    which: Tensor,
    h: Tensor,
    crossed: Tensor,
    before: Tensor,
    after: Tensor,
) -> tuple[Tensor, Tensor]:
    """Time derivative (...,) [1/s] of event `which` at `root`, and whether it is a crossing's.

    Central differences of fourth order: right to 1e-9 even where the velocities are stiff.
    """
    delta = STENCIL * h

    def value(k: int) -> Tensor:
        return probe(root + k * delta).gather(-1, which.unsqueeze(-1)).squeeze(-1)

    slope = (8.0 * (value(1) - value(-1)) - (value(2) - value(-2))) / (12.0 * delta)
    rise = _largest(after, crossed) - _largest(before, crossed)
    return slope, slope * h > GRAZE * rise + FLAT


def derivative(function: Callable[[Tensor], Tensor], at: Tensor) -> Tensor:
    """d function/d at (...,), each sample's own, as a constant."""
    if transformed():
        pulled = torch.func.vjp(function, at.detach())
        slope: Tensor = pulled[1](torch.ones_like(pulled[0]))[0]
        return slope.detach()
    with torch.enable_grad():
        free = at.detach().requires_grad_(True)
        return torch.autograd.grad(function(free).sum(), free)[0]


def _largest(events: Tensor, crossed: Tensor) -> Tensor:
    return torch.where(crossed, events, -torch.inf).amax(dim=-1)
