"""The paper's mechanism: hard attention with attention reallocation."""

from __future__ import annotations

import torch
from torch import Tensor

from ...checks import choice
from ...constraints import NonNegative
from ...functional import Numbers, one_hot
from ...types import Comparison, MemoryMode, Shift
from .attention import Attention
from .hard import attend_nearest, slot_distances

PHASES = ("initial", "always")


class ReallocatingAttention(Attention):
    """Hard attention that resets a slot when none is relevant within theta.

    Starts with one active slot. When every active slot is at least `shift_threshold` (theta [-])
    away from the hidden features, attention shifts: to the next unused slot while there is one,
    and after that, in phase ``always``, to the least relevant slot. Phase ``initial`` stops when
    all slots are in use. Paper: eqs. (decrule-addnewloc) and (indsel-aftsat).

    theta enters by comparison alone, so that autograd gives it no gradient unless resets are
    located in time (`rollout(..., gradient="hybrid")`) or relaxed (``"soft"``).

    Raises `ConfigError` for an unknown phase, `DomainError` for theta < 0.
    """

    reallocates = True
    switches = True
    starts_full = False

    def __init__(self, phase: str = "initial", shift_threshold: Numbers = 0.2) -> None:
        super().__init__()
        self.phase = choice("phase", phase, PHASES)
        self.shift_threshold: Tensor
        self.declare("shift_threshold", shift_threshold, NonNegative())

    def forward(self, comparison: Comparison, active: Tensor) -> Tensor:
        """One-hot weights (..., S), as hard attention over the active slots."""
        return attend_nearest(comparison, active)

    def decide_shift(self, distances: Tensor, mode: MemoryMode) -> Shift:
        """a_r (...,) and i_s (..., S): the first unused slot, else the least relevant one."""
        active = mode.active
        near = (distances < self.shift_threshold.unsqueeze(-1)) & active
        grows = ~active.all(dim=-1)
        fires = ~near.any(dim=-1)
        if self.phase == "initial":
            fires = fires & grows
        unused = (~active).to(torch.int64).argmax(dim=-1)
        slot = torch.where(grows, unused, distances.argmax(dim=-1))
        return Shift(fires, one_hot(slot, active.shape[-1]))

    def distances(self, comparison: Comparison, active: Tensor) -> Tensor:
        """As hard attention (..., S)."""
        return slot_distances(comparison, active)

    def margin(self, distances: Tensor, mode: MemoryMode) -> Tensor:
        """min over active slots of relevance - theta (...,); -inf after the initial phase."""
        nearest = torch.where(mode.active, distances, torch.inf).amin(dim=-1)
        beyond = nearest - self.shift_threshold
        if self.phase == "initial":
            beyond = torch.where(mode.active.all(dim=-1), -torch.inf, beyond)
        return beyond
