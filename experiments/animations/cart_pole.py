"""A cart with a pole."""

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
    Drawing,
    box_of,
    fit,
    point_arrow,
    sizes,
)
from .motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Lengths of the pole that are seen of the rail at once, at most.
_WIDEST = 10.0


class CartAndPole(Drawing):
    """Cart, pole and force; of what the reference asks for, a cart's outline and a ghost pole.

    Where the cart goes farther than a picture shows, the view goes with it.
    """

    def __init__(self, ax: Axes, motion: Motion, speed: float) -> None:
        super().__init__(ax, motion, speed)
        self.places = motion.points(motion.q)  # (K, 2, 2): pivot and mass
        asked, q = motion.references(), motion.q
        self.follows = "position" in asked, "angle" in asked
        wanted = np.stack([asked.get("position", q[:, 0]), asked.get("angle", q[:, 1])], axis=-1)
        self.asked = motion.points(wanted)
        length = float(motion.parameters["length"].max())
        self.body = (
            0.6
            * length
            * np.sqrt(motion.parameters["cart"][:, 0] / motion.parameters["cart"].max())
        )  # width of the cart; its height is half of it
        self.radii = sizes(motion.parameters["pole"][:, 0], 0.13 * length)
        ax.axhline(-0.15 * length, color="0.4", lw=1.0, zorder=1)
        self.wanted_cart = self.block(fill=False, ec=TARGET, ls="--")
        self.wanted_cart.set_visible(self.follows[0])
        self.ghost = self.line(GHOST, 4.0, alpha=0.5)
        self.ghost.set_visible(self.follows[1])
        self.path = self.line(ACTUAL, 1.4, alpha=0.8)
        self.cart = self.block(color=BODY, zorder=3)
        self.pole = self.line(JOINT, 4.0, zorder=4)
        self.mass = self.circle(MASS, zorder=5)
        self.force = self.arrow(FORCE)
        pushes = motion.applied[:, 0]
        # What the start takes for a moment would make all else invisible.
        usual = max(float(np.quantile(np.abs(pushes), 0.98)), 1e-9)
        self.push = np.clip(pushes / usual, -1.3, 1.3) * 0.5 * length
        self.length = length
        low, high = box_of(self.places[:, 0], self.asked[:, 0], length)
        masses = self.places[:, 1, 1]
        low[1], high[1] = min(-0.4 * length, masses.min()), max(0.4 * length, masses.max())
        ends = np.array([1.15, 0.25]) * length
        self.low, self.high = low - ends, high + ends
        self.rides = self.high[0] - self.low[0] > _WIDEST * length
        if self.rides:
            half = 0.5 * _WIDEST * length
            self.low[0], self.high[0] = -half, half
        fit(ax, self.low, self.high)

    def show(self, k: int) -> None:
        """Cart, pole, force and ghosts; the view where it rides along."""
        pivot = self.places[k, 0]
        for cart, x in ((self.cart, pivot[0]), (self.wanted_cart, self.asked[k, 0, 0])):
            wide = self.body[k]
            cart.set_bounds(x - 0.5 * wide, -0.25 * wide, wide, 0.5 * wide)
        self.pole.set_data(*self.places[k].T)
        self.mass.set_center(self.places[k, 1])
        self.mass.set_radius(self.radii[k])
        self.ghost.set_data(*self.asked[k].T)
        self.trail(self.path, self.places[:, 1], k)
        side = np.sign(self.push[k]) * 0.5 * self.body[k]
        start, along = np.array([pivot[0] + side, 0.0]), np.array([self.push[k], 0.0])
        point_arrow(self.force, start, along, 0.05 * self.length)
        if self.rides:
            along = np.array([pivot[0], 0.0])
            fit(self.ax, self.low + along, self.high + along)
