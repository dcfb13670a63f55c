"""Polynomials and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def derivatives(coefficients: Sequence[Tensor | float], s: Tensor, order: int) -> list[Tensor]:
    """sum_k c_k s^k and its first `order` derivatives in s, by Horner's rule.

    Coefficients (..., p), the constant one first, and s broadcast.
    """
    zero = torch.zeros_like(s + coefficients[0])
    row, found = list(coefficients), []
    for _ in range(order + 1):
        total = zero
        for c in reversed(row):
            total = c + s * total
        found.append(total)
        row = [k * c for k, c in enumerate(row)][1:]
    return found
