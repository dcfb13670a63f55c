"""A march as one differentiable function."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .engine import Job, Marcher


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
    ) -> Any:
        marcher = Marcher(job, constants.detach(), segments.detach(), carry.detach(), backward)
        marcher.forward()
        box.append(marcher)
        if backward:
            ctx.marcher = marcher
            ctx.save_for_backward(constants, segments, carry)  # torch tells if one was changed
        ctx.set_materialize_grads(False)
        return marcher.motion.cpu(), marcher.state_f.cpu()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, motion: Tensor | None, state: Tensor | None) -> Any:
        constants, segments, _ = ctx.saved_tensors
        marcher: Marcher = ctx.marcher
        program = marcher.job.program
        found_c, found_s, start = marcher.gradient(motion, state)
        full_c, full_s = torch.zeros_like(constants), torch.zeros_like(segments)
        full_c[:, program.scope.constant_columns(marcher.job.wanted[0])] = found_c
        full_s[..., program.scope.segment_columns(marcher.job.wanted[1])] = found_s
        return None, None, None, full_c, full_s, start


def march(job: Job, constants: Tensor, segments: Tensor, carry: Tensor) -> Marched:
    """Run a job from `carry` (B, F); gradients reach constants (B, P), segments (S, B, Q), carry.

    A second derivative is refused by torch. A second backward pass computes the same again.
    """
    box: list[Marcher] = []
    backward = torch.is_grad_enabled() and any(
        x.requires_grad for x in (constants, segments, carry)
    )
    motion, state = _March.apply(job, box, backward, constants, segments, carry)
    marcher = box[0]
    last_f, last_k = marcher.last()
    found = Marched(
        motion, state, marcher.state_k.cpu(), last_k, last_f,
        marcher.stop[: marcher.batch].cpu(), marcher.cause[: marcher.batch].cpu(),
    )  # fmt: skip
    marcher.forget_outputs()
    return found
