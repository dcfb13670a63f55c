"""A closed loop's vector field on flat states, as solvers take it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from ...functional import pick
from ...trees import Packer, map_tensors
from ...types import LoopMode, LoopState
from ..closed_loop import ClosedLoop
from ..conditions import Conditions
from ..lagged import AnyBlock


def flat_rates(
    loop: ClosedLoop,
    packer: Packer[LoopState],
    t: Tensor,
    y: Tensor,
    mode: LoopMode,
    here: Conditions,
    linearize: bool,
) -> tuple[Tensor, AnyBlock | None]:
    """dy/dt (..., M), and the stiff block if asked for."""
    rate, block = loop.flow(t, packer.unpack(y), mode, here, linearize)
    return packer.pack(rate), block


class FlatFlow:
    """The loop's vector field on flat states, with mode and conditions frozen.

    Rows outside `moving` (...,), all if None, stand still.
    """

    def __init__(
        self,
        rates: Callable[..., Any],
        mode: LoopMode,
        here: Conditions,
        moving: Tensor | None,
    ) -> None:
        self._rates, self._frozen, self._moving = rates, (mode, here), moving

    def __call__(self, t: Tensor, y: Tensor) -> Tensor:
        return self._hold(self._rates(t, y, *self._frozen, False)[0])

    def linearized(self, t: Tensor, y: Tensor) -> tuple[Tensor, AnyBlock | None]:
        rate, block = self._rates(t, y, *self._frozen, True)
        return self._hold(rate), map_tensors(self._hold, block)

    def _hold(self, value: Tensor) -> Tensor:
        if self._moving is None:
            return value
        return pick(self._moving, value, torch.zeros_like(value))
