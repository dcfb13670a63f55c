"""A closed loop's vector field on flat states, as solvers take it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from ...functional import pick
from ...plants.plant import Coefficients
from ...signals import Sampler
from ...trees import Packer, map_tensors
from ...types import Linearization, LoopState, Measurement, Mode
from ..closed_loop import ClosedLoop


def flat_rates(
    loop: ClosedLoop,
    packer: Packer[LoopState],
    t: Tensor,
    y: Tensor,
    mode: Mode,
    reference: Sampler,
    coefficients: Coefficients,
    noise: Measurement | None,
    linearize: bool,
) -> tuple[Tensor, Linearization | None]:
    """dy/dt (..., M), and the stiff block if asked for."""
    state = packer.unpack(y)
    rate, block = loop.flow(t, state, mode, reference, coefficients, linearize, noise)
    return packer.pack(rate), block


class FlatFlow:
    """The loop's vector field on flat states, with mode and coefficients frozen.

    Rows outside `moving` (...,), all if None, stand still.
    """

    def __init__(self, rates: Callable[..., Any], frozen: Any, moving: Tensor | None) -> None:
        self._rates, self._frozen, self._moving = rates, frozen, moving

    def __call__(self, t: Tensor, y: Tensor) -> Tensor:
        return self._hold(self._rates(t, y, *self._frozen, False)[0])

    def linearized(self, t: Tensor, y: Tensor) -> tuple[Tensor, Linearization]:
        rate, block = self._rates(t, y, *self._frozen, True)
        return self._hold(rate), map_tensors(self._hold, block)

    def _hold(self, value: Tensor) -> Tensor:
        if self._moving is None:
            return value
        return pick(self._moving, value, torch.zeros_like(value))
