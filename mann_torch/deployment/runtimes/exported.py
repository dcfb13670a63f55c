"""A step as a `torch.export` program: a graph that torch alone loads and runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.export import ExportedProgram

from .files import place_of, refusing, written
from .flat import FlatTick, FlatTicked, check_agreement, checked, example, told

if TYPE_CHECKING:
    from ..stepper import Stepper

#: What torch notes of where an operation comes from.
_REMARKS = {"stack_trace", "nn_module_stack", "source_fn_stack", "torch_fn", "from_node"}


def exported(stepper: Stepper) -> ExportedProgram:
    """The step as a program from flat tensors to flat tensors, in the stepper's precision.

    Of `state_f` (n_f,), `state_k` (n_k,), `reference` (R,), `measurement` (Y,) and `adapt` () bool
    it makes the command (m,), flags () int64, and the next state. The halves of a state are
    `stepper.blob.split(state)`; of an int64, or int32 beside float32, are the others.

    Raises `ExportError` for a controller that torch.export can't trace or that it traces to other
    numbers, `KindError`.
    """
    stepper = checked(stepper)
    name = type(stepper.tick.controller).__name__
    with torch.no_grad(), refusing(f"torch.export can't trace {name}"):
        program = torch.export.export(FlatTick(stepper).eval(), example(stepper), strict=False)
    for node in program.graph.nodes:  # sources and stacks of this machine, most of a file
        for remark in _REMARKS & node.meta.keys():
            del node.meta[remark]
    check_agreement(stepper, ExportedTick(program), "torch.export")
    return program


def to_torch_export(stepper: Stepper, path: str | os.PathLike[str]) -> Path:
    """Write the step as a `.pt2` of `torch.export.save`: torch alone runs it, in any process.

    Its extra files say which number is what. Raises as `exported`, and `ConfigError` for a path.
    """
    stepper, place = checked(stepper), place_of(path, ".pt2")
    program = exported(stepper)
    with written(place) as part, refusing("torch.export can't save it"):
        torch.export.save(program, part, extra_files=told(stepper))
    return place


class ExportedTick:
    """A program, or a file of one, in Python: five flat tensors in, `FlatTicked` out."""

    def __init__(self, program: ExportedProgram | str | os.PathLike[str]) -> None:
        if not isinstance(program, ExportedProgram):
            program = torch.export.load(place_of(program, ".pt2"))
        self._module = program.module()

    @torch.no_grad()
    def __call__(
        self, f: Tensor, k: Tensor, reference: Tensor, measurement: Tensor, adapt: Tensor
    ) -> FlatTicked:
        """One tick."""
        return FlatTicked(*self._module(f, k, reference, measurement, adapt))
