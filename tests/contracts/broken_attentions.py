"""Attentions that break a line of their contract, and what is told of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from mann_torch.constraints import Positive
from mann_torch.functional import masked_softmax, one_hot, per_matrix
from mann_torch.memory import Attention, HardAttention, ReallocatingAttention, RelaxedAttention
from mann_torch.types import Shift


class Good(Attention):
    """w ~ exp(-D^2 / T) over active slots, D the Euclidean distance: what the others break."""

    def __init__(self) -> None:
        super().__init__()
        self.temperature: Tensor
        self.declare("temperature", 0.5, Positive())

    def scores(self, comparison):
        gaps = comparison.query.unsqueeze(-2) - comparison.keys / per_matrix(comparison.scale)
        return -gaps.square().sum(-1) / self.temperature.unsqueeze(-1)

    def forward(self, comparison, active):
        return masked_softmax(self.scores(comparison), active)

    def decide_shift(self, distances, mode):
        return None


def changed(base: type = Good, *arguments: Any, **members: Any) -> Attention:
    return type("Broken", (base,), members)(*arguments)


def other_weights(compute: Callable[..., Tensor], **members: Any) -> Attention:
    """With other weights, of (self, right weights, comparison, active)."""

    def forward(self, comparison, active):
        return compute(self, Good.forward(self, comparison, active), comparison, active)

    return changed(forward=forward, **members)


def other_shift(base: type, make: Callable[[Shift], Any], *arguments: Any) -> Attention:
    """With another decision, of the right one."""

    def decide_shift(self, distances, mode):
        return make(base.decide_shift(self, distances, mode))

    return changed(base, *arguments, decide_shift=decide_shift)


def counted(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    self.calls = getattr(self, "calls", 0) + 1
    return weights if self.calls % 2 else weights.square() / weights.square().sum(-1, keepdim=True)


def written(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    comparison.keys.mul_(1.5)
    return weights


def decided(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    return weights if bool((weights > 0).any()) else weights.flip(-1)


def mixed(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    mean = self.scores(comparison).mean() if weights.dim() > 1 else 0.0
    return masked_softmax(self.scores(comparison) * (1.0 + mean), active)


def ordered(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    first = torch.arange(weights.shape[-1], dtype=weights.dtype)
    return masked_softmax(self.scores(comparison) - first, active)


def rooted(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    return masked_softmax(-torch.sqrt(-self.scores(comparison)), active)


def divided(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    scores = torch.where(active, self.scores(comparison), -torch.inf)
    return torch.where(active, torch.exp(scores / scores.abs().amin(-1, keepdim=True)), 0.0) * 0 + (
        weights
    )


def still(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    scores = self.scores(comparison) * self.temperature.unsqueeze(-1)
    return masked_softmax(scores / self.temperature.detach().unsqueeze(-1), active)


def unbatched(self: Any, weights: Tensor, comparison: Any, active: Tensor) -> Tensor:
    scores = self.scores(comparison) * self.temperature.unsqueeze(-1)
    return masked_softmax(scores / self.temperature, active)


def undeclared() -> Attention:
    broken = Good()
    broken.width = [torch.ones((), dtype=torch.float64)]
    return broken


def farthest(self, comparison, active):
    distances = self.distances(comparison, active)
    slot = torch.where(active, distances, -torch.inf).argmax(dim=-1)
    return one_hot(slot, active.shape[-1]).to(torch.float64)


SWITCHING = {"switches": True}
BROKEN: dict[str, tuple[Callable[[], Attention], str]] = {
    "a tensor that is no constant": (undeclared, "line 2: width is a tensor that is not"),
    "a flag that is a number": (lambda: changed(graded=1), "line 5: graded = 1"),
    "weights that fail on batches": (
        lambda: other_weights(lambda self, w, c, active: c.query @ c.keys),
        "line 2: forward of a batch of comparisons fails; RuntimeError",
    ),
    "a weight too many": (
        lambda: other_weights(lambda self, w, c, active: torch.cat([w, w[..., :1]], dim=-1)),
        r"line 1: forward has shape \(8, 6\), not \(8, 5\)",
    ),
    "weights of float32": (
        lambda: other_weights(lambda self, w, c, active: w.float()),
        "line 1: forward is torch.float32",
    ),
    "a weight below 0": (
        lambda: other_weights(lambda self, w, c, active: 2.0 * w - w.square()[..., :1] - 0.4),
        "line 1: a weight is negative",
    ),
    "a weight of a slot not in use": (
        lambda: other_weights(lambda self, w, c, active: 0.5 * w + 0.1),
        "line 1: an inactive slot has a weight",
    ),
    "weights of another sum": (
        lambda: other_weights(lambda self, w, c, active: 0.9 * w),
        "line 1: weights sum to 0.9",
    ),
    "something kept": (lambda: other_weights(counted), "other numbers for the same arguments"),
    "writing into the keys": (lambda: other_weights(written), "writes into its arguments"),
    "a decision in Python": (lambda: other_weights(decided), "vmap.*torch.where"),
    "samples that mix": (lambda: other_weights(mixed), "sample 0 of a batch has another forward"),
    "slots in an order": (
        lambda: other_weights(ordered),
        "line 3: other weights where the slots are in another order",
    ),
    "a root at no distance": (
        lambda: other_weights(rooted),
        "line 4: the gradient of forward is not finite where keys equal the query",
    ),
    "an infinity divided": (lambda: other_weights(divided), "line 4: the gradient.*not finite"),
    "a constant detached": (
        lambda: other_weights(still),
        "line 4: the gradient of forward by the constant temperature",
    ),
    "a constant that takes no batch": (
        lambda: other_weights(unbatched),
        r"line 4: forward with the constant temperature of shape \(8,\)",
    ),
    "a shift that is not said": (
        lambda: changed(ReallocatingAttention, reallocates=False),
        "line 5: decide_shift decides, though it never reallocates",
    ),
    "no shift": (
        lambda: changed(reallocates=True),
        "line 5: decide_shift gives a NoneType; return a Shift",
    ),
    "degrees of what is not graded": (
        lambda: other_shift(ReallocatingAttention, lambda s: s._replace(fires=s.fires.double())),
        r"line 5: fires of its Shift is torch.float64 \(8,\)",
    ),
    "a target of other slots": (
        lambda: other_shift(ReallocatingAttention, lambda s: s._replace(target=s.fires)),
        r"line 5: target of its Shift is torch.bool \(8,\)",
    ),
    "a shift to all slots": (
        lambda: other_shift(
            ReallocatingAttention, lambda s: s._replace(target=torch.ones_like(s.target))
        ),
        "line 5: its Shift is not to one slot",
    ),
    "a degree above 1": (
        lambda: other_shift(
            RelaxedAttention, lambda s: s._replace(fires=1.0 + s.fires), 0.1, "always"
        ),
        r"line 5: a degree is outside \[0, 1\]",
    ),
    "switches without distances": (
        lambda: changed(switches=True),
        "line 6: distances of a batch of comparisons fails; NotImplementedError",
    ),
    "a distance of a slot not in use": (
        lambda: changed(HardAttention, distances=lambda self, c, active: active.double()),
        "line 6: an unused slot has a finite distance",
    ),
    "weight on the farthest": (
        lambda: changed(HardAttention, forward=farthest),
        "line 6: it `switches`, but the slot of the least distance",
    ),
    "a margin that is none": (
        lambda: changed(ReallocatingAttention, margin=Attention.margin),
        "line 6: margin is not >= 0 where, and only where, decide_shift fires",
    ),
}
