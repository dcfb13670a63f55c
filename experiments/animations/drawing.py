"""A mechanism in an axis, and what drawings share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from .motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BODY, JOINT, MASS, GHOST, ACTUAL = "#33506b", "#1d2f40", "#c8742a", "0.6", "tab:blue"
TARGET, FORCE, WIND = "tab:red", "tab:green", "tab:cyan"
#: How much of a path is seen behind what moves [s of the run, for each s of the film].
TRAIL = 1.5
#: How much farther than its reference a view goes after what has run away.
_FARTHEST = 3.0


class Drawing(ABC):
    """A plant's mechanism, with its reference as a ghost; `show` moves it to a sample.

    `speed` says how many seconds of the run a second of the film is.
    """

    def __init__(self, ax: Axes, motion: Motion, speed: float) -> None:
        self.ax, self.motion = ax, motion
        step = np.diff(motion.t).mean() if len(motion.t) > 1 else 1.0
        self.behind = max(1, round(TRAIL * speed / step))
        ax.set_xlabel("x [m]", fontsize=8)
        ax.set_ylabel("y [m]", fontsize=8)
        ax.tick_params(labelsize=7)
        ax.grid(color="0.93", lw=0.6)
        ax.set_axisbelow(True)

    @abstractmethod
    def show(self, k: int) -> None:
        """Move everything to sample k."""

    def line(self, colour: str, width: float, **options: Any) -> Any:
        """A line that has no points yet."""
        joined = {"solid_capstyle": "round", "solid_joinstyle": "round", **options}
        return self.ax.plot([], [], color=colour, lw=width, **joined)[0]

    def trail(self, line: Any, path: np.ndarray, k: int) -> None:
        """What lies behind sample k of a path (K, 2)."""
        line.set_data(*path[max(0, k - self.behind) : k + 1].T)

    def arrow(self, colour: str) -> Any:
        """An arrow without length."""
        from matplotlib.patches import FancyArrow

        return self.ax.add_patch(FancyArrow(0, 0, 0, 0, color=colour, lw=0, zorder=6))

    def circle(self, colour: str, **options: Any) -> Any:
        """A disc without size."""
        from matplotlib.patches import Circle

        return self.ax.add_patch(Circle((0, 0), 0.0, color=colour, **options))

    def block(self, **options: Any) -> Any:
        """A rectangle without size."""
        from matplotlib.patches import Rectangle

        return self.ax.add_patch(Rectangle((0, 0), 0.0, 0.0, **options))


def point_arrow(arrow: Any, at: np.ndarray, along: np.ndarray, width: float) -> None:
    """Put an arrow of that width at a point (2,), pointing along (2,)."""
    length = float(np.hypot(*along))
    shown = length > 0.5 * width
    head = min(3.5 * width, 0.6 * length)
    arrow.set_visible(shown)
    if shown:
        arrow.set_data(
            x=at[0], y=at[1], dx=along[0], dy=along[1], width=width, head_length=head,
            head_width=3.0 * width,
        )  # fmt: skip


def fit(ax: Axes, low: np.ndarray, high: np.ndarray) -> None:
    """Limits, of one scale in both directions, that hold a box of corners (2,)."""
    box = ax.get_window_extent()
    middle, wide = 0.5 * (low + high), np.maximum(high - low, 1e-9)
    scale = max(wide[0] / box.width, wide[1] / box.height)
    ax.set_xlim(middle[0] - 0.5 * scale * box.width, middle[0] + 0.5 * scale * box.width)
    ax.set_ylim(middle[1] - 0.5 * scale * box.height, middle[1] + 0.5 * scale * box.height)


def box_of(paths: np.ndarray, asked: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners (2,) of what moved (K, 2), as far as it stayed near what was asked for (K, 2)."""
    low, high = asked.min(0), asked.max(0)
    room = np.maximum(_FARTHEST * (high - low), _FARTHEST * least)
    every = np.concatenate([np.clip(paths, low - room, high + room), asked])
    return every.min(0), every.max(0)


def sizes(amounts: np.ndarray, largest: float) -> np.ndarray:
    """Radii of discs whose areas are as amounts >= 0, the greatest as told."""
    return largest * np.sqrt(amounts / amounts.max(initial=1e-300))
