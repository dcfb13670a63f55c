"""Hard and reallocating attention relaxed by a temperature: smooth, with exact gradients."""

from __future__ import annotations

import torch
from torch import Tensor

from ..constraints import NonNegative, Positive
from ..errors import ConfigError
from ..functional import Numbers, infinity_distances, per_matrix
from ..types import Comparison, MemoryMode, Shift
from .attention import Attention
from .reallocating import PHASES

#: Activity below this, the smallest normal number, counts as 0: its logarithm has no slope.
TINY = torch.finfo(torch.float64).tiny


class RelaxedAttention(Attention):
    """Hard attention (phase None) or reallocating attention at a temperature T > 0.

    A slot has an activity level a_i in [0, 1]. It counts as in use to the degree
    g_i = a_i^(1/T) / (a_i^(1/T) + (1 - a_i)^(1/T)), and with that in every comparison:

    - weights w_i ~ g_i exp(-D_i / T), for hard attention's argmin of the distances D_i;
    - d_min = -T log sum_i g_i exp(-R_i / T), for the least relevance R_i = |sigma - mu_i/c_w|_inf;
    - p = sigmoid((d_min - theta) / T), for d_min >= theta. A jump resets the slot to the degree p:
      its contents, key and activity move that share of the way.

    As T -> 0 all of it becomes hard or reallocating attention. The power 1/T is what makes it so:
    where theta is not reached, p = exp(-(theta - d_min) / T) is small, but exp(-D_i / T) is as
    small, so that with g_i = a_i a slot hardly touched would win at any T if only it were near
    enough. The power also settles a slot that theta's neighbourhood has opened by half: below
    a_i = 1/2 it does not count, above it does.

    Which slot is reset is a decision without gradient, as in the hard forms: the first with
    a_i < 1/2, else (phase ``always``) the least relevant. Of active slots at exactly the same
    distance the first counts alone, as hard attention has it: without stored contents all slots
    of hard attention start equal.

    `temperature` is T, in the unit of the distances: [-], with state keys [rad]. `shift_threshold`
    is theta [-], a constant only where there is a phase. p is a share a step, so that results at
    T > 0 depend on the solver's step; the limit depends on it as the hard forms do.

    Raises `ConfigError` for an unknown phase, `DomainError` for T <= 0 or theta < 0.
    """

    graded = True

    def __init__(
        self, temperature: Numbers, phase: str | None = None, shift_threshold: Numbers = 0.2
    ) -> None:
        super().__init__()
        if phase is not None and phase not in PHASES:
            raise ConfigError(f"unknown phase '{phase}'; choose from {', '.join(PHASES)}, or None")
        self.phase = phase
        self.temperature: Tensor
        self.declare("temperature", temperature, Positive())
        if phase is not None:
            self.shift_threshold: Tensor
            self.declare("shift_threshold", shift_threshold, NonNegative())

    @property
    def reallocates(self) -> bool:  # type: ignore[override]
        """Whether there is a phase."""
        return self.phase is not None

    @property
    def starts_full(self) -> bool:  # type: ignore[override]
        """Whether there is no phase."""
        return self.phase is None

    def forward(self, comparison: Comparison, active: Tensor) -> Tensor:
        """Weights (..., S): the closest slot's is nearly 1 where T is small."""
        keys = comparison.keys / per_matrix(comparison.scale)
        distances = infinity_distances(comparison.query, keys)
        return torch.softmax(closeness(distances, active, self.temperature), dim=-1)

    def decide_shift(self, distances: Tensor, mode: MemoryMode) -> Shift | None:
        """p (...,) float64 and i_s (...,); None without a phase."""
        if self.phase is None:
            return None
        total = torch.logsumexp(closeness(distances, mode.active, self.temperature), dim=-1)
        fires = torch.sigmoid(-(total + self.shift_threshold / self.temperature))
        unused = mode.active < 0.5
        grows = unused.any(dim=-1)
        if self.phase == "initial":
            fires = torch.where(grows, fires, 0.0)
        first = unused.to(torch.int64).argmax(dim=-1)
        return Shift(fires, torch.where(grows, first, distances.argmax(dim=-1)))


def closeness(distances: Tensor, active: Tensor, temperature: Tensor) -> Tensor:
    """log g_i - D_i / T (..., S); -inf for a slot not in use, or tied with an earlier one."""
    T = temperature.unsqueeze(-1)
    partly = (active >= TINY) & (active < 1)
    level = torch.where(partly, active, 0.5)
    log_odds = level.log() - torch.log1p(-level)
    in_use = torch.where(partly, torch.nn.functional.logsigmoid(log_odds / T), 0.0)
    same = distances.unsqueeze(-1) == distances.unsqueeze(-2)
    outranked = active.unsqueeze(-1) <= active.unsqueeze(-2)
    tied = (same & outranked).tril(-1).any(dim=-1)
    return torch.where((active >= TINY) & ~tied, in_use - distances / T, -torch.inf)
