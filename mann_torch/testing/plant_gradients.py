"""Gradients of a plant's derivative: there, finite, and what differences say."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from ..trees import leaves, map_tensors
from .plant_bench import Bench, apart, called
from .telling import broken

#: Of a derivative by differences: step, and the largest error of the largest slope.
STEP, DIFFERENCES = 1e-6, 1e-4


def check_gradients(b: Bench) -> None:
    """Gradients reach state, input and parameters, and are what differences say."""
    count = len(leaves(b.state))
    names = [*(f"field {i} of the state" for i in range(count)), "the input", *b.plant.fields]
    given = b.arguments()
    names += ["the disturbance"] * (len(given) - len(names))
    for at, (name, value) in enumerate(zip(names, given, strict=True)):
        push = _pattern(value)
        # Parameters move in proportion: what is 0 may be absent.
        way = push * value if at > count else push

        def along(s: Tensor, at: int = at, way: Tensor = way) -> Tensor:
            moved = b.of([x + s * way if i == at else x for i, x in enumerate(given)])
            rate = torch.cat(leaves(moved.derivative()), dim=-1)
            return (_pattern(rate) * rate).sum()

        zero = torch.zeros((), dtype=torch.float64)
        slope = called(b.plant, 3, f"a gradient by {name}", partial(_slope, along))
        by_steps = (along(zero + STEP) - along(zero - STEP)) / (2.0 * STEP)
        if apart([slope], [by_steps]) > DIFFERENCES:
            raise broken(
                b.plant,
                3,
                f"the gradient of the derivative by {name} is not what finite differences give",
                "let gradients through: no .detach(), .item(), .data or no_grad",
            )
    _check_gradients_at_rest(b)


def _pattern(like: Tensor) -> Tensor:
    """Different numbers of one size, so that nothing cancels."""
    return torch.sin(1.0 + torch.arange(like.numel(), dtype=like.dtype)).reshape(like.shape)


def _slope(function: Callable[[Tensor], Tensor]) -> Tensor:
    """d function/d s at s = 0 by backpropagation; 0 where no gradient comes back."""
    s = torch.zeros((), dtype=torch.float64, requires_grad=True)
    with torch.enable_grad():
        value = function(s)
    if not value.requires_grad:
        return torch.zeros_like(s)
    (found,) = torch.autograd.grad(value, s, materialize_grads=True)
    return found


def _check_gradients_at_rest(b: Bench) -> None:
    rest = map_tensors(lambda row: row.clone().requires_grad_(), b.plant.rest())
    still = b.sample(0)._replace(state=rest, u=torch.zeros_like(b.u[0]))
    with torch.enable_grad():
        total = torch.stack([leaf.sum() for leaf in leaves(still.derivative())]).sum()
    found = torch.autograd.grad(total, leaves(rest), materialize_grads=True)
    if not all(bool(each.isfinite().all()) for each in found):
        raise broken(
            b.plant,
            3,
            "the gradient by the state is not finite at rest",
            "guard roots, norms and divisions at 0 before torch.where picks",
        )
