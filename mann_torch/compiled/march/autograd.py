"""A march as one differentiable function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...errors import KernelError
from .engine import Job, Marcher
from .layout import Moved


class Marched(NamedTuple):
    """What a march keeps."""

    motion: Tensor  # (T', B, n_motion)
    state_f: Tensor  # (K', B, F)
    state_k: Tensor  # (K', B, K) int64
    last_k: Tensor  # (B, K) int64, after the last step
    last_f: Tensor  # (B, F), without gradient
    stop: Tensor  # (B,) int32, the step that failed; T where none did
    cause: Tensor  # (B,) int32: 10 * watched leaf + 1 for too large, + 2 for not finite


class _March(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        job: Job,
        box: list[Marcher],
        backward: bool,
        constants: Tensor,
        segments: Tensor,
        carry: Tensor,
        shared: Tensor,
    ) -> Any:
        moved = Moved(*(x.detach() for x in (constants, segments, carry, shared)))
        marcher = Marcher(job, moved, backward)
        marcher.forward()
        box.append(marcher)
        if backward:
            ctx.marcher = marcher
            # torch tells if one was changed
            ctx.save_for_backward(constants, segments, carry, shared)
        ctx.set_materialize_grads(False)
        return marcher.motion.cpu(), marcher.state_f.cpu()

    @staticmethod
    def backward(ctx: Any, motion: Tensor | None, state: Tensor | None) -> Any:
        return None, None, None, *_Slope.apply(ctx.marcher, *ctx.saved_tensors, motion, state)


class _Slope(torch.autograd.Function):
    """The gradient of a march, itself without one.

    A function of all that the march took, so that whoever asks for a second derivative comes here:
    past `once_differentiable`, `torch.autograd.grad` finds its way to a wrong one.
    """

    @staticmethod
    def forward(
        ctx: Any,
        marcher: Marcher,
        constants: Tensor,
        segments: Tensor,
        carry: Tensor,
        shared: Tensor,
        motion: Tensor | None,
        state: Tensor | None,
    ) -> Any:
        scope = marcher.job.program.scope
        found_c, found_s, start, sums = marcher.gradient(motion, state)
        wanted, moving = marcher.job.wanted
        return (
            _spread(constants, found_c, lambda: scope.constant_columns(wanted)),
            _spread(segments, found_s, lambda: scope.segment_columns(moving)),
            start,
            _spread(shared, sums, lambda: scope.constant_columns(wanted, "shared")),
        )

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor | None) -> Any:
        raise KernelError(
            "the compiled engine has first derivatives only: for second ones take engine='torch'"
        )


def _spread(like: Tensor, found: Tensor, columns: Callable[[], Tensor]) -> Tensor:
    """Gradients of some columns, and zeros for the others."""
    if found.shape == like.shape:  # all of them are wanted
        return found
    chosen, count = columns(), found.shape[-1]
    if count and torch.equal(chosen, torch.arange(count)):  # the first ones: no need to look up
        return torch.nn.functional.pad(found, (0, like.shape[-1] - count))
    full = torch.zeros_like(like)
    full[..., chosen] = found
    return full


def march(
    job: Job, constants: Tensor, segments: Tensor, carry: Tensor, shared: Tensor | None = None
) -> Marched:
    """Run a job from `carry` (B, F); gradients reach it, constants (B, P), segments (S, B, Q).

    They reach `shared` (R,) too: constants that all samples share, side by side. All are of the
    program's dtype. A second derivative raises `KernelError`. A second backward pass computes the
    same again.
    """
    box: list[Marcher] = []
    given = (constants, segments, carry, carry.new_zeros(0) if shared is None else shared)
    backward = torch.is_grad_enabled() and any(x.requires_grad for x in given)
    motion, state = _March.apply(job, box, backward, *given)
    marcher = box[0]
    last_f, last_k = marcher.last()
    found = Marched(
        motion, state, marcher.state_k.cpu().long(), last_k, last_f,
        marcher.stop[: marcher.batch].cpu(), marcher.cause[: marcher.batch].cpu(),
    )  # fmt: skip
    marcher.forget_outputs()
    return found
