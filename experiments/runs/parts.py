"""Finished parts of a run on disk: what a killed run has done need not be done again."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .workers import REPORT_EVERY, in_parallel
from .writing import write_arrays

Part = TypeVar("Part")


def save_part(path: Path, part: Any) -> None:
    """A dataclass of numbers, arrays and dicts of arrays as one .npz file."""
    flat: dict[str, np.ndarray] = {}
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if isinstance(value, Mapping):
            flat |= {f"{field.name}/{name}": array for name, array in value.items()}
        else:
            flat[field.name] = np.asarray(value)
    write_arrays(path, flat)


def load_part(kind: type[Part], path: Path) -> Part | None:
    """The inverse; None if there is none that can be read."""
    try:
        with np.load(path) as file:
            flat = dict(file)
        given: dict[str, Any] = {}
        for field in dataclasses.fields(kind):  # type: ignore[arg-type]
            if str(field.type).startswith("dict"):
                start = f"{field.name}/"
                names = [name for name in flat if name.startswith(start)]
                given[field.name] = {name.removeprefix(start): flat[name] for name in names}
            else:
                value = flat[field.name]
                given[field.name] = value if value.ndim else value.item()
        return kind(**given)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def npz_parts(
    kind: type[Part], folder: Path
) -> tuple[Callable[[str], Part | None], Callable[[str, Part], None]]:
    """How `all_parts` reads and writes dataclasses in a folder."""
    return (
        lambda name: load_part(kind, folder / f"{name}.npz"),
        lambda name, part: save_part(folder / f"{name}.npz", part),
    )


def all_parts(
    work: Callable[..., Part],
    given: Mapping[str, tuple[Any, ...]],
    counts: Sequence[int],
    kept: tuple[Callable[[str], Part | None], Callable[[str, Part], None]],
    workers: int,
    unit: str,
    report_every: int = REPORT_EVERY,
) -> dict[str, Part]:
    """`work(*given[name], progress)` for every name, in order; what is on disk is not done again.

    `counts`: how often each calls `progress`. `kept`: what reads a part, or gives None, and what
    writes one; each is written when it is ready.
    """
    read, write = kept
    found = {name: read(name) for name in given}
    missing = [name for name in given if found[name] is None]
    if len(missing) < len(given):
        print(f"{len(given) - len(missing)} of {len(given)} parts were finished before")
    total = sum(n for name, n in zip(given, counts, strict=True) if found[name] is None)
    arguments = [given[name] for name in missing]
    if missing:
        for number, part in in_parallel(work, arguments, workers, total, unit, report_every):
            found[missing[number]] = part
            write(missing[number], part)
    return {name: part for name, part in found.items() if part is not None}
