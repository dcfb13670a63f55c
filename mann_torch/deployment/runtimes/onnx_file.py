"""A step as an ONNX file, which onnxruntime runs: no torch, no Python."""

from __future__ import annotations

import importlib.util
import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from ...errors import ExportError
from ...telling import quiet
from .exported import exported
from .files import place_of, refusing, written
from .flat import INPUTS, OUTPUTS, FlatTicked, check_agreement, checked, told

if TYPE_CHECKING:
    from ..stepper import Stepper

#: Of the extra `deploy`.
PACKAGES = ("onnx", "onnxruntime", "onnxscript")
#: Remarks on packages that are not installed.
_EXPORTER = "torch.onnx._internal.exporter._registration"


def check_onnx() -> None:
    """Raise `ExportError` where packages are missing."""
    absent = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if absent:
        raise ExportError(f"ONNX needs {', '.join(absent)}: pip install 'mann_torch[deploy]'")


def to_onnx(stepper: Stepper, path: str | os.PathLike[str]) -> Path:
    """Write the step as an `.onnx` file, run and compared with onnxruntime.

    Inputs and outputs are those of `exported`, by name: `state_f`, `state_k`, `reference`,
    `measurement`, `adapt`; `input`, `flags`, `next_f`, `next_k`. Its metadata say which number is
    what. Raises `ExportError` as `exported`, without the packages of the extra `deploy`, and for an
    operation that ONNX or onnxruntime lacks, `ConfigError` for a path.
    """
    stepper, place = checked(stepper), place_of(path, ".onnx")
    check_onnx()
    program = exported(stepper)
    name = type(stepper.tick.controller).__name__
    with refusing(f"{name} can't be written as ONNX"), quiet(_EXPORTER, logging.ERROR):
        from .onnx_operations import table

        made: Any = torch.onnx.export(
            program,
            input_names=INPUTS,
            output_names=OUTPUTS,
            custom_translation_table=table(),
            verbose=False,
        )
        for node in made.model.graph:  # remarks of the exporter, most of the file
            node.metadata_props.clear()
        made.model.metadata_props.update(told(stepper))
    with written(place) as part:
        with refusing("the ONNX file can't be written"):
            made.save(part, external_data=False)
        check_agreement(stepper, OnnxTick(part), "onnxruntime")
    return place


class OnnxTick:
    """An ONNX file in onnxruntime, on one thread: five flat tensors in, `FlatTicked` out."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        place = place_of(path, ".onnx")
        check_onnx()
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        with refusing(f"onnxruntime can't run {place.name}"):
            self.session: Any = onnxruntime.InferenceSession(
                str(place), options, providers=["CPUExecutionProvider"]
            )

    def __call__(
        self, f: Tensor, k: Tensor, reference: Tensor, measurement: Tensor, adapt: Tensor
    ) -> FlatTicked:
        """One tick."""
        given = (f, k, reference, measurement, adapt)
        rows = {name: x.numpy() for name, x in zip(INPUTS, given, strict=True)}
        return FlatTicked(*map(torch.as_tensor, self.session.run(OUTPUTS, rows)))
