"""One step in time of something that relaxes to a target, exact and stable at any step size."""

from __future__ import annotations

import torch
from torch import Tensor

#: Below this the series of `relaxation` is exact to rounding.
SMALL = 1e-8


def relaxation(z: Tensor) -> Tensor:
    """(1 - exp(-z)) / z for z >= 0, smooth through 1 at z = 0; any shape.

    >>> relaxation(torch.tensor([0.0, 1.0, 1e3], dtype=torch.float64)).tolist()
    [1.0, 0.6321205588285577, 0.001]
    """
    small = z < SMALL
    safe = torch.where(small, 1.0, z)
    return torch.where(small, 1.0 - 0.5 * z, -torch.expm1(-safe) / safe)


def exponential_step(value: Tensor, derivative: Tensor, rate: Tensor, dt: Tensor) -> Tensor:
    """value (..., S, M) after dt (...,), where derivative = rate (..., S) (target - value).

    With rate and target held it is the exact solution, target + exp(-rate dt) (value - target): it
    overshoots at no dt. A rate of 0 makes it value + dt derivative, Euler's step.
    """
    span = dt.unsqueeze(-1)
    return value + (span * relaxation(rate * span)).unsqueeze(-1) * derivative
