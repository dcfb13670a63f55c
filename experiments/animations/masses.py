"""Masses that forces push, a rail each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .drawing import BODY, FORCE, TARGET, Drawing, point_arrow
from .motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Masses(Drawing):
    """A block a coordinate, on rails one above the other, with its force and its target."""

    def __init__(self, ax: Axes, motion: Motion, speed: float) -> None:
        super().__init__(ax, motion, speed)
        asked = motion.arrays["reference"]
        n, width = asked.shape[1], np.ptp(asked)
        room = max(0.5, 0.6 * width)
        low, high = asked.min() - room, asked.max() + room
        self.view = high - low
        ax.set_xlim(low, high)
        ax.set_ylim(-n, 1)
        ax.set_yticks([-place for place in range(n)], [name for name, _ in motion.plant.outputs])
        ax.set_ylabel("")
        ax.set_xlabel("position [m]", fontsize=8)
        for place in range(n):
            ax.axhline(-place - 0.25, color="0.4", lw=1.0, zorder=1)
        masses = motion.parameters["masses"]
        self.widths = 0.12 * self.view * np.sqrt(masses / masses.max())
        self.heights = 0.5 * np.sqrt(masses / masses.max())
        self.blocks = [self.block(color=BODY, zorder=3) for _ in range(n)]
        self.targets = [self.line(TARGET, 2.0, zorder=4) for _ in range(n)]
        self.arrows = [self.arrow(FORCE) for _ in range(n)]
        pushes = motion.applied
        usual = max(float(np.quantile(np.abs(pushes), 0.98)), 1e-9)
        self.pushes = np.clip(pushes / usual, -1.3, 1.3) * 0.12 * self.view

    def show(self, k: int) -> None:
        """Blocks, targets and forces."""
        for place, block in enumerate(self.blocks):
            x, wide = self.motion.q[k, place], self.widths[k, place]
            block.set_bounds(x - 0.5 * wide, -place - 0.25, wide, self.heights[k, place])
            goal = self.motion.arrays["reference"][k, place]
            self.targets[place].set_data([goal, goal], [-place - 0.35, -place + 0.45])
            push = self.pushes[k, place]
            start = np.array([x + 0.5 * np.sign(push) * wide, -place])
            point_arrow(self.arrows[place], start, np.array([push, 0.0]), 0.012 * self.view)
