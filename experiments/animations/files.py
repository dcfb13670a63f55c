"""Films on disk, every file whole or not at all."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..runs.progress import progress_bar
from ..runs.writing import replaced, write_bytes
from ..settings.config import FilmedConfig
from .every import MP4, drawing_of, kind_of_film
from .film import Film
from .motion import Motion

if TYPE_CHECKING:
    from PIL.Image import Image

#: Colours of a GIF; more of them make it larger, and no prettier.
_COLOURS = 192
#: Bytes of a GIF, at most: frames are left out until it is small enough.
MOST_BYTES = 4_000_000


def animate(path: Path, output: FilmedConfig, motion: Motion, title: str) -> list[str]:
    """A film at `path` (without suffix) if a run's `output` asks for it; its name, if so.

    None of a plant without a drawing.
    """
    kind, drawing = kind_of_film(output), drawing_of(motion.plant)
    if kind is None or drawing is None:
        return []
    film = Film(drawing, motion, title)
    path = path.with_name(f"{path.name}.{kind}")
    if kind == MP4:
        _write_mp4(path, film)
    else:
        write_bytes(path, gif_of(film))
    return [path.name]


def gif_of(film: Film) -> bytes:
    """All frames in the same few colours, repeated for ever."""
    from PIL import Image

    samples, plain = film.pace.samples, Image.Dither.NONE
    places = np.unique(np.linspace(0, len(samples) - 1, 5).round().astype(int))
    some = np.concatenate([film.picture(samples[place]) for place in places])
    palette = _with_white(Image.fromarray(some).quantize(_COLOURS, dither=plain))
    frames = [
        Image.fromarray(film.picture(k)).quantize(palette=palette, dither=plain)
        for k in _counted(samples)
    ]
    delay = film.pace.delay
    while True:
        buffer = io.BytesIO()
        first, *others = frames
        first.save(
            buffer, "GIF", save_all=True, append_images=others, duration=round(1000 * delay), loop=0
        )
        if buffer.tell() <= MOST_BYTES or len(frames) < 3:
            return buffer.getvalue()
        frames, delay = frames[::2], 2 * delay


def _with_white(few: Image) -> Image:
    """What is nearly white becomes white: Pillow would take a mean of both for the paper."""
    colours = np.array(few.getpalette()).reshape(-1, 3)
    colours[colours.min(-1) > 245] = 255
    few.putpalette(colours.ravel().tolist())
    return few


def _write_mp4(path: Path, film: Film) -> None:
    from matplotlib.animation import FFMpegWriter

    logging.getLogger("matplotlib.animation").setLevel(logging.WARNING)  # not each command
    writer = FFMpegWriter(fps=1.0 / film.pace.delay, extra_args=["-f", "mp4"])  # type: ignore[arg-type]
    with replaced(path) as temporary, writer.saving(film.figure, str(temporary), film.figure.dpi):
        for k in _counted(film.pace.samples):
            film.show(k)
            writer.grab_frame()


def _counted(samples: Sequence[int]) -> Iterator[int]:
    with progress_bar(len(samples), "frame") as bar:
        for k in samples:
            yield k
            bar.update()
