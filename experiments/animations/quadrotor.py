"""A quadrotor in a vertical plane, in wind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .drawing import (
    ACTUAL,
    BODY,
    FORCE,
    GHOST,
    JOINT,
    MASS,
    TARGET,
    WIND,
    Drawing,
    box_of,
    fit,
    point_arrow,
)
from .motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Half of the body's width, of the view.
_BODY = 0.075
#: Half of the body's width, as far as the moment is concerned [m]: a uniform rod's.
_ROD = 0.25


class Quadrotor(Drawing):
    """Body, thrusts, wind, and the pose that the reference asks for.

    Inputs are over mass and inertia: the body is drawn as it is seen, and each rotor's share of
    the moment is that of a uniform rod 0.5 m wide.
    """

    def __init__(self, ax: Axes, motion: Motion, speed: float) -> None:
        super().__init__(ax, motion, speed)
        asked = motion.arrays["reference"]
        low, high = box_of(motion.q[:, :2], asked[:, :2], 0.5)
        self.size = _BODY * max(float((high - low).max()), 1.0)
        self.wanted = self.line(TARGET, 1.0, alpha=0.5, linestyle="--")
        self.wanted.set_data(*asked[:, :2].T)
        self.path = self.line(ACTUAL, 1.4, alpha=0.8)
        self.ghost = self.line(GHOST, 5.0, alpha=0.55)
        self.body = self.line(BODY, 4.0, zorder=4)
        self.rotors = [self.line(JOINT, 2.0, zorder=5) for _ in range(2)]
        self.hub = self.circle(MASS, zorder=6)
        self.hub.set_radius(0.22 * self.size)
        self.thrusts = [self.arrow(FORCE) for _ in range(3)]
        inputs = motion.applied
        turning = inputs[:, 1] * _ROD / 6  # I / m = d^2 / 3 at a distance of 2 d
        self.forces = np.stack(
            [0.5 * inputs[:, 0] - turning, 0.5 * inputs[:, 0] + turning, inputs[:, 2]], axis=-1
        )
        usual = float(np.quantile(np.abs(self.forces[:, :2]), 0.9))
        self.forces = np.clip(self.forces / max(usual, 1e-9), -3.0, 3.0) * 1.4 * self.size
        self.wind = motion.arrays.get("disturbance")
        self.gust = self.arrow(WIND)
        self.said = ax.text(
            0.985, 0.97, "", transform=ax.transAxes, ha="right", va="top", fontsize=8, color="0.3"
        )
        fit(ax, low - 3.2 * self.size, high + 3.2 * self.size)
        self.corner = np.array([ax.get_xlim()[1], ax.get_ylim()[1]])
        self.width = float(np.diff(ax.get_xlim())[0])

    def show(self, k: int) -> None:
        """Body, ghost, arrows and trail."""
        asked = self.motion.arrays["reference"]
        across, up, middle = self._axes(self.motion.q[k])
        ends = np.stack([middle - across, middle + across])
        self.body.set_data(*ends.T)
        for rotor, end in zip(self.rotors, ends, strict=True):
            hub = end + 0.3 * up
            rotor.set_data(*np.stack([hub - 0.45 * across, hub + 0.45 * across]).T)
        self.hub.set_center(middle)
        along, _, place = self._axes(asked[k])
        self.ghost.set_data(*np.stack([place - along, place + along]).T)
        self.trail(self.path, self.motion.q[:, :2], k)
        starts = (ends[0] + 0.35 * up, ends[1] + 0.35 * up, middle)
        directions = (up, up, across)
        for arrow, start, way, force in zip(
            self.thrusts, starts, directions, self.forces[k], strict=True
        ):
            point_arrow(arrow, start, way / self.size * force, 0.12 * self.size)
        if self.wind is not None:
            speed = float(self.wind[k, 0])
            most = float(np.abs(self.wind[:, 0]).max())
            length = 0.15 * self.width * speed / max(most, 1e-9)
            start = self.corner - np.array([0.11 * self.width + 0.5 * length, 0.09 * self.width])
            point_arrow(self.gust, start, np.array([length, 0.0]), 0.01 * self.width)
            self.said.set_text(f"wind {speed:.1f} m/s")

    def _axes(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Half of the body (2,), as much upwards, and its middle, of x, y and pitch."""
        cos, sin = self.size * np.cos(pose[2]), self.size * np.sin(pose[2])
        return np.array([cos, sin]), np.array([-sin, cos]), pose[:2]
