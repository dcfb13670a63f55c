"""Arms of links, rigid and flexible in their joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mann_torch.plants import FlexibleJointArm

from .drawing import ACTUAL, BODY, FORCE, GHOST, JOINT, MASS, TARGET, Drawing, fit, sizes
from .motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Arm(Drawing):
    """Links, masses by their size, and the arm that the reference asks for behind them.

    A motor's angle before a flexible joint is a hand at it.
    """

    def __init__(self, ax: Axes, motion: Motion, speed: float) -> None:
        super().__init__(ax, motion, speed)
        self.places = self.points(motion.q)  # (K, n + 1, 2)
        self.asked = self.points(motion.arrays["reference"])
        lengths = np.linalg.norm(np.diff(self.places, axis=1), axis=-1)
        reach = float(lengths.sum(-1).max())
        self.ghost = self.line(GHOST, 4.0, alpha=0.45)
        self.wanted = self.line(TARGET, 1.0, alpha=0.5, linestyle="--")
        self.path = self.line(ACTUAL, 1.4, alpha=0.8)
        self.links = self.line(BODY, 5.0)
        self.joints = self.line(JOINT, 0.0, marker="o", ms=5.5, mec="w", mew=0.8)
        self.target = self.line(TARGET, 0.0, marker="+", ms=11, mew=1.6, zorder=7)
        masses = self.masses()
        self.radii = sizes(masses, 0.07 * reach)
        centers = motion.parameters.get("centers", np.ones_like(masses))
        along = np.diff(self.places, axis=1)[:, : masses.shape[1]]
        self.middles = self.places[:, : masses.shape[1]] + centers[..., None] * along
        self.discs = [self.circle(MASS, zorder=4) for _ in masses.T]
        self.hands = self.motors(lengths)
        self.springs = [self.line(FORCE, 2.0, zorder=5) for _ in range(self.hands.shape[1])]
        swept = np.concatenate([self.places, self.asked]).reshape(-1, 2)
        fit(ax, swept.min(0) - 0.15 * reach, swept.max(0) + 0.15 * reach)

    def points(self, q: np.ndarray) -> np.ndarray:
        """Base and ends of the links (K, n + 1, 2) [m]."""
        return self.motion.points(q)

    def masses(self) -> np.ndarray:
        """How heavy the links are (K, n) [kg]."""
        return self.motion.parameters["masses"]

    def motors(self, lengths: np.ndarray) -> np.ndarray:
        """Hands at flexible joints (K, n, 2) [m], as long as part of a link; (K, 0, 2) for none."""
        plant, q = self.motion.plant, self.motion.q
        if not isinstance(plant, FlexibleJointArm):
            return np.zeros((len(q), 0, 2))
        n = plant.n_links
        before = np.cumsum(q[:, :n], axis=-1) - q[:, :n]
        angle = before + q[:, n:]
        return 0.3 * lengths[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def show(self, k: int) -> None:
        """Arm, ghost, masses and trails."""
        for line, rows in ((self.links, self.places), (self.ghost, self.asked)):
            line.set_data(*rows[k].T)
        self.joints.set_data(*self.places[k, :-1].T)
        self.target.set_data(*self.asked[k, -1:].T)
        self.trail(self.path, self.places[:, -1], k)
        self.trail(self.wanted, self.asked[:, -1], k)
        for place, spring in enumerate(self.springs):
            start = self.places[k, place]
            spring.set_data(*np.stack([start, start + self.hands[k, place]]).T)
        for disc, middle, radius in zip(self.discs, self.middles[k], self.radii[k], strict=True):
            disc.set_center(middle)
            disc.set_radius(radius)


class UnitArm(Arm):
    """An arm whose parameters say nothing of its lengths: links are as long as the unit."""

    def __init__(self, ax: Axes, motion: Motion, speed: float) -> None:
        super().__init__(ax, motion, speed)
        ax.set_xlabel("x [links]", fontsize=8)
        ax.set_ylabel("y [links]", fontsize=8)

    def points(self, q: np.ndarray) -> np.ndarray:
        """Base and ends of the links (K, n + 1, 2) [links]."""
        theta = np.cumsum(q, axis=-1)
        along = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        return np.concatenate([np.zeros_like(along[:, :1]), np.cumsum(along, axis=1)], axis=1)

    def masses(self) -> np.ndarray:
        """None that are known (K, 0)."""
        return np.zeros((len(self.motion.t), 0))
