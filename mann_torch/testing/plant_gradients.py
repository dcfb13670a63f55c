"""Gradients of a plant's derivative: there, finite, and what differences say."""

from __future__ import annotations

import torch
from torch import Tensor

from ..trees import leaves, map_tensors
from .plant_bench import Bench
from .slopes import along_way, check_slope, pattern, totals
from .telling import broken


def check_gradients(b: Bench) -> None:
    """Gradients reach state, input and parameters, and are what differences say."""
    count = len(leaves(b.state))
    names = [*(f"field {i} of the state" for i in range(count)), "the input", *b.plant.fields]
    given = b.arguments()
    names += ["the disturbance"] * (len(given) - len(names))
    for at, (name, value) in enumerate(zip(names, given, strict=True)):
        push = pattern(value)
        # Parameters move in proportion: what is 0 may be absent.
        way = push * value if at > count else push

        def along(s: Tensor, at: int = at, way: Tensor = way) -> Tensor:
            moved = b.of([along_way(x, s, way) if i == at else x for i, x in enumerate(given)])
            return totals(leaves(moved.derivative()))

        check_slope(b.plant, 3, ("the derivative", name), along)
    _check_gradients_at_rest(b)


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
