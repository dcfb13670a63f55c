"""How limits count, and samples that diverged, in whatever is minimised."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, POSITIVE, maybe, number

#: From here on what is minimised grows by its logarithm only: no member outshouts the others.
STEEP = 10.0
#: What a sample that diverged is worth: flat, and beyond a 500-fold excess.
DIVERGED = 50.0


def limited(
    total: Tensor, limits: Iterable[tuple[Tensor, float]], penalty: float, ok: Tensor
) -> Tensor:
    """`total` and `penalty` times the squared relative excess of each (value, limit), (..., B).

    `total` is 1 at the start or so. Where not `ok` it must be finite, too: it counts for nothing,
    but NaN would leave NaN gradients.
    """
    for value, limit in limits:
        total = total + penalty * torch.relu(value / limit - 1.0).square()
    excess = (total / STEEP).clamp(min=1.0).log()
    total = total.clamp(max=STEEP) + STEEP * excess
    return torch.where(ok, total.clamp(max=DIVERGED), DIVERGED)


def check_weight(what: str, value: float) -> None:
    """Raise `ConfigError` unless finite and >= 0."""
    number(what, value, NONNEGATIVE)


def check_limit(what: str, value: float | None) -> None:
    """Raise `ConfigError` unless finite and > 0, or None."""
    maybe(what, value, POSITIVE)
