"""Base gain and robustifying term."""

from __future__ import annotations

from torch import Tensor

from ..constraints import DesignModule, NonNegative, Positive
from ..functional import Numbers


class RobustGain(DesignModule):
    """Gain on r: -u_bl - v = (K_v + k_v (|W|_F + |V|_F + |mu|_F + Z_m)) r.

    `base_gain` K_v [N m s/rad], `robust_gain` k_v, `weight_bound` Z_m. Paper: the robot arm's
    control law, eq. (clawrobotarm) and the lines after it.
    """

    def __init__(
        self,
        base_gain: Numbers = 20.0,
        robust_gain: Numbers = 10.0,
        weight_bound: Numbers = 0.0,
    ) -> None:
        super().__init__()
        self.base_gain: Tensor
        self.robust_gain: Tensor
        self.weight_bound: Tensor
        self.declare("base_gain", base_gain, Positive())
        self.declare("robust_gain", robust_gain, NonNegative())
        self.declare("weight_bound", weight_bound, NonNegative())

    def forward(self, norms: Tensor) -> Tensor:
        """Gain (...,) [N m s/rad] at the sum of weight and memory norms (...,)."""
        return self.base_gain + self.robust_gain * (norms + self.weight_bound)
