"""What is minimised: tracking error plus what the torque costs, relative to the start."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError
from .ensemble import Score

#: From here on the objective grows by its logarithm only, so that no member outshouts the others.
STEEP = 10.0
#: The objective of a sample that diverged: flat, and beyond a 500-fold excess.
DIVERGED = 50.0


@dataclass(frozen=True)
class Objective:
    """SRMSE / SRMSE_0 + `effort_weight` * rate / rate_0 + penalties, for each member.

    Rate is the RMS torque rate, and 0 stands for the constants one starts from. `rate_limit` and
    `peak_limit` are multiples of the start's rate and peak torque, `saturation` [N m] is what the
    actuators can give; what exceeds a limit counts `penalty` times its square. None: no limit.

    Raises `ConfigError` for a weight < 0 or a limit that is not > 0.
    """

    effort_weight: float = 0.0
    rate_limit: float | None = 1.0
    peak_limit: float | None = 1.0
    saturation: float | None = None
    penalty: float = 20.0

    def __post_init__(self) -> None:
        for name in ("effort_weight", "penalty"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(f"objective {name} = {value}: must be finite and >= 0")
        for name in ("rate_limit", "peak_limit", "saturation"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ConfigError(f"objective {name} = {value}: must be finite and > 0, or null")

    def __call__(self, score: Score, start: Score) -> Tensor:
        """(..., B) from the scores (..., B) and those of the start (B,)."""
        ok = torch.isfinite(score.srmse) & torch.isfinite(score.rate) & torch.isfinite(score.peak)
        # NaN, even where it counts for nothing, would leave NaN gradients.
        score = Score(*(torch.where(ok, a, b) for a, b in zip(score, start, strict=True)))
        rate = score.rate / start.rate
        # Before `effort_after` there is no peak yet.
        peak = torch.where(start.peak > 0, score.peak / start.peak.clamp(min=1e-12), 0.0)
        total = score.srmse / start.srmse + self.effort_weight * rate
        limits = ((rate, self.rate_limit), (peak, self.peak_limit), (score.peak, self.saturation))
        for value, limit in limits:
            if limit is not None:
                total = total + self.penalty * torch.relu(value / limit - 1.0).square()
        excess = (total / STEEP).clamp(min=1.0).log()
        total = total.clamp(max=STEEP) + STEEP * excess
        return torch.where(ok, total.clamp(max=DIVERGED), DIVERGED)
