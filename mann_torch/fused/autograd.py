"""The fused rollout as one differentiable function."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .engine import Marcher
from .job import KEPT, LEAVES, Inputs, Job


class Kept(NamedTuple):
    """What a fused rollout keeps: T' motion rows and K state rows; None where there is no such."""

    motion: Tensor  # (T', B, 3n or 5n), columns as in `job.MOTION`
    q: Tensor  # (K, B, n), the state from here on
    qd: Tensor  # (K, B, n)
    W: Tensor  # (K, B, N, n)
    b_w: Tensor  # (K, B, n)
    V: Tensor  # (K, B, I, N)
    b_v: Tensor  # (K, B, N)
    mu: Tensor | None  # (K, B, S, N)
    keys: Tensor | None  # (K, B, S, n)
    active: Tensor | None  # (K, B, S) float64, 1 for slots in use
    counts: Tensor | None  # (K, B, 3) int32: attended, switches, reallocations; hybrid: 6, with
    # located, sliding and unresolved events
    last_active: Tensor | None  # (B, S) after the last step
    last_counts: Tensor | None  # (B, 3)
    stop: Tensor  # (B,) int32, the step that failed; T where none did
    cause: Tensor  # (B,) int32, see equations/guard.py


class _March(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, job: Job, box: list[Marcher], backward: bool, *flat: Tensor | None
    ) -> Any:
        inputs = Inputs(*(None if x is None else x.detach().contiguous() for x in flat))  # type: ignore[arg-type]
        ctx.names = [name for name in KEPT if getattr(inputs, name) is not None]
        marcher = Marcher(job, inputs, backward)
        starts = marcher.forward()
        box.append(marcher)
        if backward:
            ctx.marcher, ctx.starts = marcher, starts
            ctx.save_for_backward(*flat)  # the marcher reads them: torch tells if one was changed
        ctx.set_materialize_grads(False)
        return (marcher.motion, *(marcher.kept[name] for name in ctx.names))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, motion: Tensor | None, *leaves: Tensor | None) -> Any:
        _ = ctx.saved_tensors
        outputs = {"motion": motion}
        outputs |= {f"{name}_out": g for name, g in zip(ctx.names, leaves, strict=True)}
        found = ctx.marcher.gradient(ctx.starts, outputs)
        return None, None, None, *(found.get(name) for name in Inputs._fields)


def march(job: Job, inputs: Inputs) -> Kept:
    """Run the rollout of `job`; gradients reach every tensor of `inputs`.

    Everything is on the job's device, and so is the result. A second derivative is refused by
    torch. A second backward pass through the same rollout computes the same again.
    """
    box: list[Marcher] = []
    backward = torch.is_grad_enabled() and any(x is not None and x.requires_grad for x in inputs)
    motion, *leaves = _March.apply(job, box, backward, *inputs)
    marcher = box[0]
    names = [name for name in KEPT if getattr(inputs, name) is not None]
    leaves_by_name = dict(zip(names, leaves, strict=True))
    kept = Kept(
        motion=motion,
        **{name: leaves_by_name.get(name) for name in LEAVES},  # type: ignore[arg-type]
        active=marcher.kept.get("active"),
        counts=marcher.kept.get("counts"),
        last_active=marcher.last.get("active"),
        last_counts=marcher.last.get("counts"),
        stop=marcher.stop,
        cause=marcher.cause,
    )
    marcher.forget_outputs()
    return kept
