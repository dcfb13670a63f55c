"""What is minimised: tracking error plus what the input costs, relative to the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

from ..errors import ConfigError
from ..functional import as_float64
from ..simulation import Trajectory
from .ensemble import Ensemble, Score, score
from .judges import TOTALS, Recording
from .limits import check_limit, check_weight, limited


class Aim(Protocol):
    """What a tuner minimises: an `Objective` or, with judges of one's own, a `Criterion`."""

    @property
    def recording(self) -> Recording:
        """What rollouts must keep."""

    def measure(self, trajectory: Trajectory, /) -> Any:
        """A NamedTuple of tensors (..., B, *event); NaN for a sample that diverged."""

    def __call__(self, measured: Any, start: Any, /) -> Tensor:
        """What is minimised (..., B), from what was measured and what was at the start (B, ...)."""


@dataclass(frozen=True)
class Objective:
    """SRMSE / SRMSE_0 + `effort_weight` * rate / rate_0 + penalties, for each member.

    Rate is the RMS rate of the input, and 0 stands for the constants one starts from. `rate_limit`
    and `peak_limit` are multiples of the start's rate and peak, `saturation`, in the input's unit,
    is what the actuators can give; what exceeds a limit counts `penalty` times its square. None: no
    limit.

    Raises `ConfigError` for a weight < 0 or a limit that is not > 0.
    """

    effort_weight: float = 0.0
    rate_limit: float | None = 1.0
    peak_limit: float | None = 1.0
    saturation: float | None = None
    penalty: float = 20.0

    def __post_init__(self) -> None:
        for name in ("effort_weight", "penalty"):
            check_weight(f"objective {name}", getattr(self, name))
        for name in ("rate_limit", "peak_limit", "saturation"):
            check_limit(f"objective {name}", getattr(self, name))

    def check_fit(self, ensemble: Ensemble) -> None:
        """Raise `ConfigError` where peaks are bounded that no member would ever show."""
        after, shortest = ensemble.effort_after, float(as_float64(ensemble.scenario.horizon).min())
        bounded = self.peak_limit is not None or self.saturation is not None
        if bounded and after is not None and after >= shortest:
            raise ConfigError(
                f"effort_after = {after:g} s: peaks count from there on, and a horizon of "
                f"{shortest:g} s has none; give the Ensemble a smaller effort_after, or the "
                "Objective peak_limit=None and no saturation"
            )

    @property
    def recording(self) -> Recording:
        """Totals are enough."""
        return TOTALS

    def measure(self, trajectory: Trajectory) -> Score:
        """The scores (..., B)."""
        return score(trajectory)

    def __call__(self, score: Score, start: Score) -> Tensor:
        """(..., B) from the scores (..., B) and those of the start (B,)."""
        ok = torch.isfinite(score.srmse) & torch.isfinite(score.rate) & torch.isfinite(score.peak)
        # NaN, even where it counts for nothing, would leave NaN gradients.
        score = Score(*(torch.where(ok, a, b) for a, b in zip(score, start, strict=True)))
        # Inputs that stand still at the start have no rate, and before `effort_after` no peak.
        moved = start.rate > 0
        rate = torch.where(moved, score.rate / torch.where(moved, start.rate, 1.0), 0.0)
        peak = torch.where(start.peak > 0, score.peak / start.peak.clamp(min=1e-12), 0.0)
        total = score.srmse / start.srmse + self.effort_weight * rate
        limits = ((rate, self.rate_limit), (peak, self.peak_limit), (score.peak, self.saturation))
        given = [(value, limit) for value, limit in limits if limit is not None]
        return limited(total, given, self.penalty, ok)
