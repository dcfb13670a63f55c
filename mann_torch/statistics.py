"""Means with their uncertainty."""

from __future__ import annotations

import math

import torch
from scipy.stats import t as student
from torch import Tensor

CONFIDENCE = 0.95


def student_factor(degrees: int) -> float:
    """Half-width of the 95 % interval in standard errors; inf without a degree of freedom."""
    if degrees < 1:
        return math.inf
    return float(student.ppf(0.5 + 0.5 * CONFIDENCE, degrees))


def mean_and_half(values: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and Student-t 95 % half-width over the first dimension: (n, ...) -> (...), (...).

    The values are independent; the half-width of a single one is NaN.
    """
    n = len(values)
    if n < 2:
        return values.mean(dim=0), torch.full_like(values[0], torch.nan)
    error = values.std(dim=0) / math.sqrt(n)
    return values.mean(dim=0), student_factor(n - 1) * error
