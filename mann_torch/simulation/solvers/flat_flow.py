"""A closed loop's vector field on flat states, as solvers take it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from ...errors import InterfaceError
from ...functional import pick
from ...trees import Packer, difference, map_tensors
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
    """dy/dt (..., M), and the stiff block if asked for.

    Raises `InterfaceError` for a part whose derivative is not of its state's form.
    """
    state = packer.unpack(y)
    rate, block = loop.flow(t, state, mode, here, linearize)
    for name, its, wanted in zip(state._fields, rate, state, strict=True):
        told = difference(its, wanted, name)
        if told is not None:
            part = type(getattr(loop, name)).__name__
            raise InterfaceError(f"{part}: the derivative is not of the state's form: {told}")
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
