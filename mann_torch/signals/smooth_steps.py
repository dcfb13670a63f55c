"""Values that change smoothly at given times."""

from __future__ import annotations

import torch
from torch import Tensor

from ..checks import whole
from ..errors import ConfigError, ShapeError
from ..functional import Numbers
from ..types import ReferenceSample
from .pieces import check_increasing
from .powers import derivatives
from .reference import Reference
from .rows import spread

#: Smoothsteps from 0 to 1 by their degree: the constant coefficient first.
SMOOTHSTEPS: dict[int, tuple[float, ...]] = {
    5: (0.0, 0.0, 0.0, 10.0, -15.0, 6.0),
    7: (0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0),
}


class SmoothSteps(Reference):
    """Steps of which each takes its `duration` [s] from its time on.

    s(t) = v_0 + sum_k (v_{k+1} - v_k) S((t - t_k) / d_k), S the smoothstep of `degree` 5,
    continuous up to the acceleration, or 7, up to the jerk. `times` (..., K) [s] increase, `values`
    are (..., K + 1, p), `duration` broadcasts to (..., K); steps may overlap, they add up. All
    three receive gradients. Raises `ConfigError`, `ShapeError`, `KindError` or `DtypeError`.
    """

    order = 4

    def __init__(self, times: Numbers, values: Numbers, duration: Numbers, degree: int = 5) -> None:
        super().__init__()
        self.times: Tensor
        self.values: Tensor
        self.duration: Tensor
        self.degree = whole("degree", degree)
        if self.degree not in SMOOTHSTEPS:
            raise ConfigError(f"degree = {self.degree}: choose 5 or 7")
        times, values = self.hold("times", times), self.hold("values", values, 2)
        if values.shape[-2] != times.shape[-1] + 1:
            raise ShapeError(
                f"{self._kind} of times {tuple(times.shape)} and values {tuple(values.shape)}: "
                "one value row more than times is needed"
            )
        self.hold("duration", spread(f"{self._kind} duration", duration, times.shape[-1:]))
        check_increasing(self._kind, times)
        if bool((self.duration <= 0).any()):
            raise ConfigError(f"{self._kind} duration = {self.duration.tolist()}: must be > 0")
        self.width = values.shape[-1]
        self.share_batch()

    def at(self, t: Tensor) -> ReferenceSample:
        """s and four derivatives."""
        share = (t - self.times) / self.duration
        moving = (share >= 0) & (share < 1)
        done, *rates = derivatives(SMOOTHSTEPS[self.degree], share.clamp(0.0, 1.0), self.order)
        jumps = torch.diff(self.values, dim=-2)
        found = [self.values[..., 0, :] + (done.unsqueeze(-1) * jumps).sum(dim=-2)]
        unit = torch.ones_like(self.duration)
        for rate in rates:
            unit = unit * self.duration
            part = torch.where(moving, rate, 0.0) / unit
            found.append((part.unsqueeze(-1) * jumps).sum(dim=-2))
        return ReferenceSample(*found)
