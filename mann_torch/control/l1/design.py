"""Matrices that an L1 controller is designed with."""

from __future__ import annotations

import torch
from torch import Tensor

from ...domains import Finite
from ...errors import ConfigError, ShapeError
from ...functional import Numbers, as_float64
from ..lyapunov import check_stable


def stable_pair(A_m: Numbers, B: Numbers) -> tuple[Tensor, Tensor]:
    """A_m (d, d) and B (d, m), checked: A_m is stable, B of full rank.

    Raises `ShapeError`, `ConfigError`, `DomainError`, `KindError` or `DtypeError`.
    """
    A = Finite().check("A_m", as_float64(A_m, "A_m").detach().clone())
    b = Finite().check("B", as_float64(B, "B").detach().clone())
    if A.dim() != 2 or A.shape[0] != A.shape[1] or b.dim() != 2 or len(b) != len(A) or not len(A):
        raise ShapeError(
            f"A_m of shape {tuple(A.shape)} and B of {tuple(b.shape)}: give (d, d) and (d, m)"
        )
    check_stable("A_m", A)
    if int(torch.linalg.matrix_rank(b)) != b.shape[1]:
        raise ConfigError(f"B of shape {tuple(b.shape)} has dependent columns: inputs do the same")
    return A, b
