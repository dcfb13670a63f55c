"""The folder: written beside its place, and put there whole."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import ExportError, KindError
from ..stepper import Stepper
from .form import Form, form_of
from .header import TITLE, header
from .makefile import FLAGS, makefile
from .readme import Measured, readme
from .replay import STEPS, recorded, replay
from .source import source

if TYPE_CHECKING:
    from collections.abc import Mapping

#: Flags that sizes are measured with.
_SIZED = "-O2"


def to_c(
    stepper: Stepper,
    folder: str | os.PathLike[str],
    name: str = "controller",
    constants: str = "baked",
    libm: bool = True,
) -> Path:
    """Write a stepper as C99: see `Stepper.to_c`."""
    if not isinstance(folder, str | os.PathLike):
        raise KindError(f"folder = {folder!r}: must be a path")
    place = Path(folder)
    form = form_of(stepper, name, constants, libm)
    _check_place(place, form)
    files = {
        f"{name}.h": header(form),
        f"{name}.c": source(form),
        f"test_{name}.c": replay(form, recorded(stepper)),
        "Makefile": makefile(form),
    }
    place.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=f".{place.name}-", dir=place.parent))
    try:
        _write(made, files)
        _write(made, {"README.md": readme(form, STEPS, _sizes(made, form))})
        made.chmod(0o755)
        _put(made, place)
    finally:
        shutil.rmtree(made, ignore_errors=True)
    return place


def _write(folder: Path, files: Mapping[str, str]) -> None:
    for file, text in files.items():
        (folder / file).write_text(text)


def _check_place(place: Path, form: Form) -> None:
    """Raise `ExportError` where there is something other than an export of this controller."""
    if not place.exists():
        return
    if not place.is_dir():
        raise ExportError(f"{place} is a file: give a folder")
    if not any(place.iterdir()):
        return
    found = place / f"{form.name}.h"
    first = found.read_text().split("\n")[0] if found.is_file() else ""
    if first != TITLE + form.title:
        raise ExportError(
            f"{place} holds something else than an export of {form.title}: give another folder"
        )


def _put(made: Path, place: Path) -> None:
    """Rename, an earlier export out of the way first."""
    if not place.exists():
        made.rename(place)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{place.name}-", dir=place.parent))
    place.rename(old / "old")
    try:
        made.rename(place)
    except OSError:
        (old / "old").rename(place)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


def _sizes(folder: Path, form: Form) -> list[Measured]:
    """Of the compilers that are here; none where one of them does not do it."""
    found = []
    for compiler in ("gcc", "clang"):
        path = shutil.which(compiler)
        if path is not None and shutil.which("size") is not None:
            measured = _size(path, folder, form)
            found += [measured] if measured else []
    return found


def _size(compiler: str, folder: Path, form: Form) -> Measured | None:
    with tempfile.TemporaryDirectory() as room:
        made = Path(room) / f"{form.name}.o"
        command: list[Any] = [compiler, *FLAGS, _SIZED, "-fstack-usage", "-c"]
        try:
            subprocess.run(
                [*command, folder / f"{form.name}.c", "-o", made],
                check=True, capture_output=True, cwd=room, timeout=120,
            )  # fmt: skip
            out = subprocess.run(
                ["size", "-A", "-d", made], check=True, capture_output=True, text=True
            ).stdout
            version = subprocess.run(
                [compiler, "-dumpversion"], check=True, capture_output=True, text=True
            ).stdout.strip()
            parts = [line.split()[:2] for line in out.splitlines() if line.startswith(".")]
            used = [line.split("\t") for line in made.with_suffix(".su").read_text().splitlines()]
            step = sum(int(b) for place, b, _ in used if place.split(":")[-1] in _steps(form))
        except (OSError, subprocess.SubprocessError, ValueError, IndexError):
            return None
    name = f"{Path(compiler).name} {version} {_SIZED}, {platform.machine()}"

    def total(*kinds: str) -> int:
        return sum(int(size) for part, size in parts if part.startswith(kinds))

    return Measured(name, total(".text"), total(".rodata"), total(".data", ".bss"), step)


def _steps(form: Form) -> tuple[str, str]:
    """The functions that a step goes through, if they are not joined."""
    return f"{form.name}_step", f"{form.name}_advance"
