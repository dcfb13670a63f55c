"""A plant in a loop whose input comes from outside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import whole
from ..control import Controller
from ..types import ControllerTree, ControlOutput, Mode, ReferenceSample


class Told(NamedTuple):
    """What the controller was told to command."""

    input: Tensor  # (..., m)


class GivenInput(Controller):
    """Commands what its mode holds, which only whoever steps the loop changes."""

    def __init__(self, n_inputs: int) -> None:
        super().__init__()
        self.n_inputs = whole("n_inputs", n_inputs)

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[ControllerTree, Mode]:
        """Nothing commanded yet."""
        return None, Told(torch.zeros(*batch_shape, self.n_inputs, dtype=torch.float64))

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: ControllerTree, mode: Mode
    ) -> ControlOutput:
        """What it was told."""
        return ControlOutput(mode.input, None, None)
