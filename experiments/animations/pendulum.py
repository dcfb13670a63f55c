"""A pendulum."""

from __future__ import annotations

import numpy as np

from .arms import Arm


class HangingArm(Arm):
    """An arm of one link, with its mass at the end; q = 0 hangs down."""

    def masses(self) -> np.ndarray:
        """(K, 1) [kg]."""
        return self.motion.parameters["mass"]
