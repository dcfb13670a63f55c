"""How a controller's state gets from one instant to the next, where it runs at instants alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torch import Tensor

from ..functional import second_mean
from ..types import ControllerTree, Mode, ReferenceSample
from .controller import Controller


def moved(
    controller: Controller,
    elapsed: Tensor,
    reference: ReferenceSample,
    measurement: Any,
    state: ControllerTree,
    mode: Mode,
    rates: ControllerTree,
    decay: ControllerTree = None,
) -> ControllerTree:
    """The state `elapsed` (...,) [s] after the instant of `rates` r_0 and `decay` l_0.

    By the trapezoid of its rates, r_0 and those at this instant,

        x* = x + P r_0,  x+ = x + P/2 (r_0 + r(x*)),

    which is Heun's rule where rates depend on the state. A number that forgets, x' = a - l x
    (`ControlOutput.decay`), moves by the exponential rule of the same order,

        x* = x + P p_1(Pl) r_0,  x+ = x* + P p_2(Pl) (r(x*) - r_0 + l (x* - x)),

    p_1(z) = (1 - e^-z)/z, p_2(z) = (1 - p_1(z))/z: exact, at any period, where a and l stay as they
    are, as at the paper's write law between two samples (Cox and Matthews, J. Comput. Phys. 176,
    2002, eq. 22).
    """
    if state is None:
        return None

    def first(slow: Tensor | None, x: Tensor, r: Tensor) -> Tensor:
        time = _beside(elapsed, x)
        if slow is None:
            return x + time * r
        z = time * slow
        return x + time * (1.0 - z * second_mean(z)) * r

    def second(slow: Tensor | None, x: Tensor, trial: Tensor, r: Tensor, s: Tensor) -> Tensor:
        time = _beside(elapsed, x)
        if slow is None:
            return x + 0.5 * time * (r + s)
        return trial + time * second_mean(time * slow) * (s - r + slow * (trial - x))

    trial = _each(first, decay, state, rates)
    ahead = controller(reference, measurement, trial, mode).d_state
    return _each(second, decay, state, trial, rates, ahead)


def _each(function: Callable[..., Tensor], decay: Any, *trees: Any) -> Any:
    """`function` of each tensor of `decay`, None where it has none, and of its partners."""
    if trees[0] is None:
        return None
    if isinstance(trees[0], Tensor):
        return function(decay, *trees)
    own = [None] * len(trees[0]) if decay is None else decay
    return type(trees[0])(
        *(_each(function, d, *parts) for d, *parts in zip(own, *trees, strict=True))
    )


def _beside(time: Tensor, x: Tensor) -> Tensor:
    """(...,) beside a leaf (..., *event)."""
    return time.reshape(time.shape + (1,) * (x.dim() - time.dim()))
