"""What a controller is written for: a check that it can be, and the writing of its files."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mann_torch.deployment import Stepper
from mann_torch.deployment.c_code.form import check_name, form_of
from mann_torch.deployment.runtimes import exported, to_aoti, to_onnx, to_torch_export
from mann_torch.deployment.runtimes.aoti import check_aoti
from mann_torch.deployment.runtimes.onnx_file import check_onnx

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


def check_torch_export(stepper: Stepper, cfg: ExportedConfig) -> None:
    """Raise `MannError` for a controller that torch.export can't trace."""
    exported(stepper)


def check_compiler(stepper: Stepper, cfg: ExportedConfig) -> None:
    """As `check_torch_export`, and where AOTInductor has no compiler."""
    check_aoti()
    check_torch_export(stepper, cfg)


def check_packages(stepper: Stepper, cfg: ExportedConfig) -> None:
    """As `check_torch_export`, and where packages are missing."""
    check_onnx()
    check_torch_export(stepper, cfg)


#: What goes in and out of a program of flat tensors.
_FLAT = (
    "Inputs are `state_f`, `state_k`, `reference`, `measurement` and `adapt`, outputs `input`, "
    "`flags`, `next_f` and `next_k`; its metadata name their numbers."
)
RUNTIMES: dict[str, Runtime] = {
    "c": Runtime(
        "C99",
        check_c,
        write_c,
        "`c/{name}.h` and `c/{name}.c` are all there is to compile, for gcc or clang\n\n"
        "    cc -std=c99 -O2 -ffp-contract=off -c {name}.c\n\n"
        "and `make test` there replays steps recorded in Python. `c/README.md` names every number.",
    ),
    "torch_export": Runtime(
        "torch.export",
        check_torch_export,
        lambda stepper, cfg, folder: to_torch_export(stepper, folder / f"{cfg.name}.pt2"),
        f"`torch.export.load` of torch alone reads it, in any process. {_FLAT}",
    ),
    "aoti": Runtime(
        "AOTInductor",
        check_compiler,
        lambda stepper, cfg, folder: to_aoti(stepper, folder / f"{cfg.name}.pt2"),
        "C++ loads it by `torch::inductor::AOTIModelPackageLoader`, Python by "
        "`torch._inductor.aoti_load_package`, with libtorch of this version on a machine like this "
        f"one. {_FLAT}",
    ),
    "onnx": Runtime(
        "ONNX",
        check_packages,
        lambda stepper, cfg, folder: to_onnx(stepper, folder / f"{cfg.name}.onnx"),
        f"onnxruntime runs it, without torch. {_FLAT}",
    ),
}


def check_runtimes(stepper: Stepper, cfg: ExportedConfig) -> None:
    """Raise `MannError` for a name of no file, or a runtime that can't have this controller."""
    check_name(cfg.name)
    with _quiet():
        for name in cfg.runtimes:
            RUNTIMES[name].check(stepper, cfg)


def write_runtime(name: str, stepper: Stepper, cfg: ExportedConfig, folder: Path) -> Path:
    """A runtime's files in a folder of its own; what a killed run left is removed.

    Raises `MannError`, `OSError`.
    """
    for before in (*folder.glob(f".{name}-*"), folder / name):
        shutil.rmtree(before, ignore_errors=True)
    with _quiet():
        RUNTIMES[name].write(stepper, cfg, folder / name)
    return folder / name


@contextmanager
def _quiet() -> Iterator[None]:
    """Exporters tell of each of their rewritings, and Hydra listens."""
    before = logging.root.manager.disable
    logging.disable(max(before, logging.INFO))
    try:
        yield
    finally:
        logging.disable(before)
