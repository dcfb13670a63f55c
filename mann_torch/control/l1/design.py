"""Matrices that an L1 controller is designed with."""

from __future__ import annotations

import torch
from torch import Tensor

from ...domains import Finite, SymmetricPositiveDefinite
from ...errors import ConfigError, ShapeError
from ...functional import Numbers, as_float64


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


def check_stable(name: str, A: Tensor) -> float:
    """Slowest decay [1/s] of exp(A t). Raises `ConfigError` where there is none."""
    largest = float(torch.linalg.eigvals(A.detach()).real.max())
    if largest >= 0:
        raise ConfigError(f"{name} has an eigenvalue of real part {largest:.3g}: must be below 0")
    return -largest


def lyapunov(A: Tensor, weight: Numbers) -> Tensor:
    """P (d, d) of A'P + P A = -Q, Q = `weight`. Raises `ShapeError`, `DomainError`, `KindError`."""
    d = len(A)
    domain = SymmetricPositiveDefinite()
    Q = domain.coerce(as_float64(weight, "weight").detach(), torch.Size((d, d)))
    if Q.shape != (d, d):
        raise ShapeError(f"weight of shape {tuple(Q.shape)}: give {(d, d)}, a row, or one number")
    eye = torch.eye(d, dtype=A.dtype)
    # Row by row, A'P is kron(A', 1) and P A is kron(1, A').
    system = torch.kron(A.mT.contiguous(), eye) + torch.kron(eye, A.mT.contiguous())
    P = torch.linalg.solve(system, -domain.check("weight", Q).reshape(-1)).reshape(d, d)
    return 0.5 * (P + P.mT)
