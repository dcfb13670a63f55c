"""A step as an AOTInductor package: machine code that libtorch loads, without Python."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ...errors import ExportError
from .exported import exported
from .files import first_line, place_of, refusing, written
from .flat import FlatTicked, check_agreement, checked, told

if TYPE_CHECKING:
    from ..stepper import Stepper


def check_aoti() -> None:
    """Raise `ExportError` where AOTInductor has no C++ compiler."""
    from torch._inductor.cpp_builder import get_cpp_compiler

    try:
        get_cpp_compiler()
    except Exception as error:
        raise ExportError(
            f"AOTInductor needs a C++ compiler (g++ or clang++, or CXX): {first_line(error)}"
        ) from None


def to_aoti(stepper: Stepper, path: str | os.PathLike[str]) -> Path:
    """Compile the step into a `.pt2` of AOTInductor, for one core of a machine like this one.

    C++ loads it with `torch::inductor::AOTIModelPackageLoader`, Python with
    `torch._inductor.aoti_load_package`; both need libtorch of the version it was made by. Inputs
    and outputs are those of `exported`, its metadata say which number is what. Compiling takes half
    a minute. Raises `ExportError` as `exported` and without a C++ compiler, `ConfigError` for a
    path, `KindError`.
    """
    stepper, place = checked(stepper), place_of(path, ".pt2")
    check_aoti()
    program = exported(stepper)
    options = {"cpp.threads": 1, "aot_inductor.metadata": told(stepper)}
    name = type(stepper.tick.controller).__name__
    with written(place) as part:
        with torch.no_grad(), refusing(f"AOTInductor can't compile {name}"):
            torch._inductor.aoti_compile_and_package(
                program, package_path=str(part), inductor_configs=options
            )
        check_agreement(stepper, AotiTick(part), "AOTInductor")
    return place


class AotiTick:
    """A package in Python: five flat tensors in, `FlatTicked` out."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        place = place_of(path, ".pt2")
        with refusing(f"{place} can't be loaded"):
            self._module = torch._inductor.aoti_load_package(str(place), run_single_threaded=True)

    @torch.no_grad()
    def __call__(
        self, f: Tensor, k: Tensor, reference: Tensor, measurement: Tensor, adapt: Tensor
    ) -> FlatTicked:
        """One tick."""
        return FlatTicked(*self._module(f, k, reference, measurement, adapt))
