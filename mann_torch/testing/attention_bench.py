"""What an attention is checked with: comparisons as a key rule makes them, slots in use or not."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..memory import Attention, KeyRule
from ..types import Comparison, MemoryMode, MemoryState
from .functions import SAMPLES

SLOTS, HIDDEN, CONTEXT = 5, 6, 2


class Compared(NamedTuple):
    """What weights depend on."""

    comparison: Comparison  # query (SAMPLES, D), keys (SAMPLES, S, D), scale (SAMPLES,)
    active: Tensor  # (SAMPLES, S)


class Judged(NamedTuple):
    """What decisions depend on."""

    distances: Tensor  # (SAMPLES, S)
    mode: MemoryMode


def compared(attention: Attention, rule: KeyRule, seed: int = 0, at_rest: bool = False) -> Compared:
    """A random comparison; `at_rest`, one whose keys all equal the query, as they start."""
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return torch.randn(SAMPLES, *shape, generator=generator, dtype=torch.float64)

    hidden, context = torch.sigmoid(draw(HIDDEN)), draw(CONTEXT)
    gain = torch.full((SAMPLES,), 0.75, dtype=torch.float64)
    keys = draw(SLOTS, rule.width(CONTEXT))
    mu = 0.4 * draw(SLOTS, HIDDEN)
    if at_rest:
        mu = (0.75 * hidden).unsqueeze(-2).expand_as(mu)
        keys = rule.fresh_keys(context).unsqueeze(-2).expand_as(keys)
    comparison = rule.query_keys(hidden, context, MemoryState(mu, keys), gain)
    scale = comparison.scale.expand(SAMPLES)
    return Compared(comparison._replace(scale=scale), active_slots(attention, generator))


def active_slots(attention: Attention, generator: torch.Generator) -> Tensor:
    """Slots in use (SAMPLES, S): of the first sample all, of the second the first alone."""
    drawn = torch.rand(SAMPLES, SLOTS, generator=generator, dtype=torch.float64)
    active = drawn < 0.6
    active[0], active[1], active[:, 0] = True, False, True
    if not attention.graded:
        return active
    levels = drawn.lerp(torch.ones_like(drawn), 0.3) * active
    levels[:2] = active[:2].to(torch.float64)
    return levels


def judged(attention: Attention) -> Judged:
    """Relevances from near to far, so that some decisions fall one way and some the other."""
    generator = torch.Generator().manual_seed(1)
    drawn = torch.rand(SAMPLES, SLOTS, generator=generator, dtype=torch.float64)
    distances = drawn * torch.logspace(-2, 1, SAMPLES, dtype=torch.float64).unsqueeze(-1)
    count = torch.zeros(SAMPLES, dtype=torch.int64)
    active = active_slots(attention, generator)
    return Judged(distances, MemoryMode(active, count - 1, count, count.clone()))


def weights_of(attention: Any, given: Compared) -> Tensor:
    """Weights (SAMPLES, S)."""
    found: Tensor = attention(given.comparison, given.active)
    return found


def distances_of(attention: Any, given: Compared) -> Tensor:
    """What a switching mechanism compares (SAMPLES, S), 0 in place of infinity."""
    found = attention.distances(given.comparison, given.active)
    return torch.where(given.active > 0, found, 0.0)
