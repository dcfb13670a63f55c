"""Files that appear whole, and errors of one line."""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...checks import instance
from ...errors import ConfigError, ExportError, KindError, MannError

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def place_of(path: object, suffix: str) -> Path:
    """A path that ends as a runtime wants it. Raises `KindError`, `ConfigError`."""
    if not isinstance(path, str | os.PathLike):
        raise KindError(f"path = {path!r}: must be a path")
    place = Path(instance("path", os.fspath(path), str))
    if place.suffix != suffix:
        raise ConfigError(f"path = {place}: such a file ends in {suffix}")
    if place.is_dir():
        raise ConfigError(f"path = {place}: is a folder")
    return place


@contextmanager
def written(place: Path) -> Iterator[Path]:
    """Where to write a file that is put in its place at the end."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{place.stem}-", dir=place.parent) as room:
        part = Path(room) / place.name
        yield part
        part.replace(place)


@contextmanager
def refusing(what: str) -> Iterator[None]:
    """`ExportError` of one line for whatever torch's exporters raise, and no chatter.

    They raise of every kind: what they meet in a user's module is raised through them.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except MannError:
        raise
    except Exception as error:
        raise ExportError(f"{what}: {first_line(error)}") from error


def first_line(error: BaseException) -> str:
    """What an error's first cause says first, or of what kind it is."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [_COLOUR.sub("", line).strip() for line in str(error).splitlines()]
    return next(filter(None, lines), type(error).__name__)
