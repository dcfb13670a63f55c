"""What a controller is written for: a check that it can be, and the writing of its files."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mann_torch.deployment import Stepper
from mann_torch.deployment.c_code.form import form_of

from ..settings.export_config import ExportedConfig


@dataclass(frozen=True)
class Runtime:
    """How a runtime's files are checked before anything is there, written, and used."""

    title: str
    check: Callable[[Stepper, ExportedConfig], object]
    write: Callable[[Stepper, ExportedConfig, Path], object]
    use: str  # how, in Markdown; {name} is the export's


def check_c(stepper: Stepper, cfg: ExportedConfig) -> None:
    """Raise `MannError` for a controller that can't be written in C."""
    form_of(stepper, cfg.name, cfg.constants, cfg.libm)


def write_c(stepper: Stepper, cfg: ExportedConfig, folder: Path) -> None:
    """Header, source, test and Makefile."""
    stepper.to_c(folder, cfg.name, constants=cfg.constants, libm=cfg.libm)


RUNTIMES: dict[str, Runtime] = {
    "c": Runtime(
        "C99",
        check_c,
        write_c,
        "`c/{name}.h` and `c/{name}.c` are all there is to compile, for gcc or clang\n\n"
        "    cc -std=c99 -O2 -ffp-contract=off -c {name}.c\n\n"
        "and `make test` there replays steps recorded in Python. `c/README.md` names every number.",
    ),
}


def check_runtimes(stepper: Stepper, cfg: ExportedConfig) -> None:
    """Raise `ConfigError`, or what a runtime raises, for one that can't have this controller."""
    for name in cfg.runtimes:
        RUNTIMES[name].check(stepper, cfg)


def write_runtime(name: str, stepper: Stepper, cfg: ExportedConfig, folder: Path) -> Path:
    """A runtime's files in a folder of its own; what a killed run left half beside it is removed.

    Raises `MannError`, `OSError`.
    """
    for half in folder.glob(f".{name}-*"):
        shutil.rmtree(half, ignore_errors=True)
    RUNTIMES[name].write(stepper, cfg, folder / name)
    return folder / name
