"""Hard and reallocating attention relaxed by a temperature: smooth, with exact gradients."""

from __future__ import annotations

import torch
from torch import Tensor

from ...checks import choice
from ...constraints import NonNegative, Positive
from ...functional import Numbers, infinity_distances, per_matrix
from ...types import Comparison, MemoryMode, Shift
from .attention import Attention
from .reallocating import PHASES


class RelaxedAttention(Attention):
    """Hard attention (phase None) or reallocating attention at a temperature T > 0.

    A slot has an activity level a_i in [0, 1]. It counts as in use to the degree
    g_i = a_i^(1/T) / (a_i^(1/T) + (1 - a_i)^(1/T)), and with that everywhere:

    - weights w_i ~ g_i exp(-D_i / T), for hard attention's argmin of the distances D_i;
    - d_min = -T log sum_i g_i exp(-R_i / T), for the least relevance R_i = |sigma - mu_i/c_w|_inf;
    - p = sigmoid((d_min - theta) / T), for d_min >= theta;
    - u_i = (1 - g_i) g_1 ... g_(i-1), for the first unused slot; in phase ``always`` what is left,
      g_1 ... g_S, goes to slots by g_i exp(R_i / T), for the least relevant one.

    A jump resets slot i to the degree p u_i: contents, key and activity move that share of the
    way. No decision is left, so that the loop is continuous in its constants. As T -> 0 it becomes
    hard or reallocating attention. The power 1/T is what makes it so: where theta is not reached,
    p ~ exp(-(theta - d_min) / T) is small, but exp(-D_i / T) is as small, so that with g_i = a_i a
    slot hardly touched would win, at any T, if only it were near enough.

    Of slots at exactly the same distance the first counts alone, as hard attention has it: without
    stored contents all slots of hard attention start equal.

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
        self.phase = None if phase is None else choice("phase", phase, PHASES)
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
        use = log_use(active, self.temperature)
        return torch.softmax(closeness(distances, use, self.temperature), dim=-1)

    def decide_shift(self, distances: Tensor, mode: MemoryMode) -> Shift | None:
        """p (...,) and u (..., S), degrees; None without a phase."""
        if self.phase is None:
            return None
        T = self.temperature
        use = log_use(mode.active, T)
        total = torch.logsumexp(closeness(distances, use, T), dim=-1)
        fires = torch.sigmoid(-(total + self.shift_threshold / T))
        all_used = torch.nn.functional.pad(use, (1, 0)).cumsum(dim=-1).exp()  # g_1 ... g_i
        target = all_used[..., :-1] - all_used[..., 1:]
        if self.phase == "always":
            farthest = torch.softmax(closeness(-distances, use, T), dim=-1)
            target = target + all_used[..., -1:] * farthest
        return Shift(fires, target)


def log_use(active: Tensor, temperature: Tensor) -> Tensor:
    """log g_i (..., S), g_i the degree to which a slot of activity a_i is in use."""
    tiny = torch.finfo(active.dtype).tiny  # below it a_i counts as 0: its logarithm has no slope
    partly = (active >= tiny) & (active < 1)
    level = torch.where(partly, active, 0.5)
    log_odds = level.log() - torch.log1p(-level)
    log_g = torch.nn.functional.logsigmoid(log_odds / temperature.unsqueeze(-1))
    return torch.where(partly, log_g, torch.where(active < tiny, -torch.inf, 0.0))


def closeness(distances: Tensor, use: Tensor, temperature: Tensor) -> Tensor:
    """log g_i - D_i / T (..., S); -inf for a slot tied with an earlier one, no less in use."""
    same = distances.unsqueeze(-1) == distances.unsqueeze(-2)
    outranked = use.unsqueeze(-1) <= use.unsqueeze(-2)
    tied = (same & outranked).tril(-1).any(dim=-1)
    return torch.where(tied, -torch.inf, use - distances / temperature.unsqueeze(-1))
