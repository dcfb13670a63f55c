"""Frames of a run: the mechanism, the time, what a schedule moved, and the memory's slots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..runs.figures import COLOURS
from ..runs.memory_figures import attends
from .drawing import Drawing
from .motion import Motion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Width and height of a frame [pixel], even ones for the sake of video codecs.
WIDTH, HEIGHT = 560, 480
_DPI = 100
#: Frames a second, and seconds of a film, at most.
RATE, LONGEST = 20, 15.0
#: A frame of a GIF lasts whole hundredths of a second.
_TICK = 0.01
_STRIP = 400  # pixels of the memory's strip


@dataclass(frozen=True)
class Pace:
    """Which samples are frames, how long each lasts [s], and how fast the run goes by."""

    samples: tuple[int, ...]
    delay: float
    speed: float

    @property
    def text(self) -> str:
        """The speed in words."""
        return "real time" if abs(self.speed - 1) < 0.005 else f"{self.speed:.3g} x real time"


def pace_of(t: np.ndarray) -> Pace:
    """Of samples at times (K,) [s]: real time, or as many times faster as makes it short enough."""
    length = float(t[-1] - t[0])
    if not length > 0:
        return Pace((0,), 1.0 / RATE, 1.0)
    speed = max(1, math.ceil(length / LONGEST - 1e-9))
    between = max(speed / RATE, length / (len(t) - 1))
    count = math.floor(length / between + 1e-9) + 1
    wanted = t[0] + between * np.arange(count)
    after = np.clip(np.searchsorted(t, wanted), 1, len(t) - 1)
    nearest = after - (wanted - t[after - 1] < t[after] - wanted)
    delay = max(1, math.floor(between / speed / _TICK + 1e-6)) * _TICK
    return Pace(tuple(map(int, nearest)), delay, between / delay)


class Film:
    """A run in a figure that is moved from frame to frame."""

    def __init__(self, drawing: type[Drawing], motion: Motion, title: str) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.motion, self.pace = motion, pace_of(motion.t)
        self.figure: Figure = Figure(figsize=(WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI)
        self.canvas = FigureCanvasAgg(self.figure)
        remembers = attends(motion.arrays)
        bottom = 0.27 if remembers else 0.1
        ax = self.figure.add_axes((0.1, bottom, 0.87, 0.89 - bottom))
        self.figure.text(0.5, 0.97, title, ha="center", va="center", fontsize=9)
        self.drawing = drawing(ax, motion, self.pace.speed)
        self.time = self.figure.text(0.1, 0.91, "", ha="left", va="center", fontsize=9)
        self.moved = self.figure.text(0.97, 0.91, "", ha="right", va="center", fontsize=9)
        self.now: Any = self._memory() if remembers else None

    def show(self, k: int) -> None:
        """Everything at sample k."""
        self.drawing.show(k)
        self.time.set_text(f"t = {self.motion.t[k]:.2f} s, {self.pace.text}")
        told = []
        for name in self.motion.moved:
            row = ", ".join(f"{value:.3g}" for value in self.motion.parameters[name][k])
            told.append(f"{name} {row} {self.motion.plant.fields[name].unit}")
        self.moved.set_text("; ".join(told))
        if self.now is not None:
            self.now.set_xdata([self.motion.t[k]] * 2)

    def picture(self, k: int) -> np.ndarray:
        """Sample k (height, width, 3) as bytes."""
        self.show(k)
        self.canvas.draw()
        return np.asarray(self.canvas.buffer_rgba())[..., :3].copy()

    def _memory(self) -> Any:
        """A strip of slots against time, darker where more is attended to; the mark of now."""
        run = self.motion.arrays
        t, shares = run["t"], run["weights"]
        ax = self.figure.add_axes((0.1, 0.085, 0.87, 0.105))
        columns = np.searchsorted(t, np.linspace(t[0], t[-1], _STRIP)).clip(0, len(t) - 1)
        from matplotlib.colors import to_rgb

        slots = shares.shape[-1]
        colours = np.array([to_rgb(COLOURS[slot % len(COLOURS)]) for slot in range(slots)])
        held = shares[columns].T[..., None]  # (S, columns, 1)
        extent = (t[0], max(t[-1], t[0] + 1e-9), 0.5, slots + 0.5)
        image = 1.0 - held * (1.0 - colours[:, None])
        ax.imshow(image, origin="lower", extent=extent, aspect="auto", interpolation="nearest")
        ax.set_yticks(range(1, slots + 1) if slots <= 5 else (1, slots))
        ax.set_ylabel("slot", fontsize=8)
        ax.set_xlabel("t [s]", fontsize=8, labelpad=1)
        ax.tick_params(labelsize=7)
        return ax.axvline(t[0], color="k", lw=1.2)
