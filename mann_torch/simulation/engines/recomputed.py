"""A stretch of a rollout that leaves no tape: its backward pass computes it again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from ...errors import SolverError

#: A function of a flat list of tensors to another one.
Stretch = Callable[[Sequence[Tensor]], Sequence[Tensor]]


class _Recomputed(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, stretch: Stretch, *given: Tensor) -> Any:
        found = tuple(x.clone() if any(x is y for y in given) else x for x in stretch(given))
        ctx.stretch, ctx.found = stretch, [x.detach() for x in found]
        ctx.save_for_backward(*given)
        ctx.mark_non_differentiable(*(x for x in found if not x.is_floating_point()))
        ctx.set_materialize_grads(False)
        return found

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor | None) -> Any:
        # With create_graph the second derivative goes through here: then the inputs keep their
        # past; as views, so that one given twice has two gradients.
        again, needed = torch.is_grad_enabled(), ctx.needs_input_grad[1:]
        with torch.enable_grad():
            given = [
                x.view_as(x) if again else x.detach().requires_grad_(need).view_as(x)
                for x, need in zip(ctx.saved_tensors, needed, strict=True)
            ]
            found = ctx.stretch(given)
        _check_again(ctx.found, found, given)
        asked = [
            (x, g)
            for x, g in zip(found, gradients, strict=True)
            if g is not None and x.requires_grad
        ]
        wanted = [x for x, need in zip(given, needed, strict=True) if need]
        if not asked or not wanted:
            return (None, *(None for _ in given))
        slopes = iter(
            torch.autograd.grad(
                [x for x, _ in asked], wanted, [g for _, g in asked],
                allow_unused=True, create_graph=again,
            )
        )  # fmt: skip
        return (None, *(next(slopes) if need else None for need in needed))


def _check_again(
    before: Sequence[Tensor], found: Sequence[Tensor], given: Sequence[Tensor]
) -> None:
    """Raise `SolverError` if steps came to other numbers now, or reach what they may not."""
    if len(before) != len(found) or not all(
        torch.equal(a, b) or torch.equal(a.nan_to_num(), b.nan_to_num())
        for a, b in zip(before, found, strict=True)
    ):
        what = "came to other numbers: a part draws or counts"
    elif not reaches_only(found, given):
        what = "reach a tensor that no module owns: its gradient would be lost"
    else:
        return
    raise SolverError(
        f"steps that are computed again for the gradient {what}; a larger tape_memory keeps them"
    )


def recomputed(stretch: Stretch, given: Sequence[Tensor]) -> Sequence[Tensor]:
    """stretch(given), whose intermediate results are not kept.

    Gradients reach `given` alone; backwards, `SolverError` where more is reached, or where the
    stretch comes to other results.
    """
    found: Sequence[Tensor] = _Recomputed.apply(stretch, *given)
    return found


def reaches_only(results: Sequence[Tensor], given: Sequence[Tensor]) -> bool:
    """Whether all that the results are differentiated to lies behind `given`, all of them views."""
    ends = {(x.grad_fn, x.output_nr) for x in given if x.grad_fn is not None}
    stack: list[tuple[Any, int]] = [(x.grad_fn, x.output_nr) for x in results]
    seen: set[Any] = set()
    while stack:
        node = stack.pop()
        if node[0] is None or node in ends or node[0] in seen:
            continue
        seen.add(node[0])
        if hasattr(node[0], "variable"):
            return False
        stack.extend(node[0].next_functions)
    return True
