"""Pictures on disk: in the formats asked for, every file whole or not at all."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mann_torch.errors import ConfigError

from ..settings.config import PicturesConfig
from .writing import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("png", "pdf", "svg")
DPI = 110.0


def check_pictures(output: PicturesConfig) -> None:
    """Raise `ConfigError` for formats or dots per inch that no picture can have."""
    _formats_of(output.format)
    if not 10 <= output.dpi <= 2400:
        raise ConfigError(f"output.dpi = {output.dpi:g}: must be 10 to 2400")


def save(figure: Figure, path: Path, formats: Sequence[str] = ("png",), dpi: float = DPI) -> None:
    """Write a picture in each format."""
    for name in formats:
        buffer = io.BytesIO()
        figure.savefig(buffer, format=name, dpi=dpi)
        write_bytes(path.with_suffix(f".{name}"), buffer.getvalue())


def save_all(folder: Path, figures: Mapping[str, Figure], output: PicturesConfig) -> None:
    """Write pictures by name, as a command's `output` asks."""
    for name, figure in figures.items():
        save(figure, folder / name, _formats_of(output.format), output.dpi)


def linked(names: Iterable[str], output: PicturesConfig) -> str:
    """Pictures in a Markdown report, in the first of their formats."""
    first = _formats_of(output.format)[0]
    return "".join(f"\n![{Path(name).name}]({name}.{first})\n" for name in names)


def _formats_of(given: Any) -> tuple[str, ...]:
    """From a list, or from names with commas."""
    names = given.split(",") if isinstance(given, str) else given
    if not isinstance(names, list | tuple) or not names:
        raise ConfigError(f"output.format = {given}: choose from {', '.join(FORMATS)}")
    found = [str(name).strip() for name in names]
    for name in found:
        if name not in FORMATS:
            raise ConfigError(f"output.format: no '{name}'; choose from {', '.join(FORMATS)}")
    return tuple(dict.fromkeys(found))
