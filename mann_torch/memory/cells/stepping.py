"""One step in time of something that relaxes to a target, exact and stable at any step size."""

from __future__ import annotations

import torch
from torch import Tensor


def relaxation(z: Tensor) -> Tensor:
    """(1 - exp(-z)) / z for z >= 0, smooth through 1 at z = 0; any shape.

    >>> relaxation(torch.tensor([0.0, 1.0, 1e3], dtype=torch.float64)).tolist()
    [1.0, 0.6321205588285577, 0.001]
    """
    # Below it the series is exact to rounding, and the quotient's slope is not.
    small = z < (1e-3 if z.dtype == torch.float64 else 1e-1)
    near, far = torch.where(small, z, 0.0), torch.where(small, 1.0, z)
    series = torch.ones_like(z)
    for n in (6, 5, 4, 3, 2):
        series = 1.0 - near / n * series
    return torch.where(small, series, -torch.expm1(-far) / far)


def exponential_step(value: Tensor, derivative: Tensor, rate: Tensor, dt: Tensor) -> Tensor:
    """value (..., S, M) after dt (...,), where derivative = rate (..., S) (target - value).

    With rate and target held it is the exact solution, target + exp(-rate dt) (value - target): it
    overshoots at no dt. A rate of 0 makes it value + dt derivative, Euler's step.
    """
    span = dt.unsqueeze(-1)
    return value + (span * relaxation(rate * span)).unsqueeze(-1) * derivative


def share_of(rate: Tensor, dt: Tensor) -> Tensor:
    """1 - exp(-rate dt) (..., S): how far in dt (...,) something goes towards a held target."""
    return -torch.expm1(-rate * dt.unsqueeze(-1))
