"""Stable matrices, and the gain of the error that drives, from their Lyapunov equation."""

from __future__ import annotations

import torch
from torch import Tensor

from ..constraints import SymmetricPositiveDefinite
from ..errors import DomainError, ShapeError
from ..functional import Numbers, as_float64


def lyapunov(A: Tensor, Q: Tensor) -> Tensor:
    """P (n, n) with A'P + P A = -Q, by Kronecker's product: (I x A' + A' x I) vec P = -vec Q."""
    n, rows = len(A), A.mT.contiguous()
    eye = torch.eye(n, dtype=A.dtype)
    both = torch.kron(eye, rows) + torch.kron(rows, eye)
    P = torch.linalg.solve(both, -Q.reshape(-1)).reshape(n, n)
    return 0.5 * (P + P.mT)


def check_stable(name: str, A: Tensor) -> float:
    """Slowest decay [1/s] of exp(A t), (n, n). Raises `DomainError` where there is none."""
    rates = torch.linalg.eigvals(A.detach()).real
    if not bool((rates < 0).all()):
        raise DomainError(
            f"{name}: its eigenvalues have real parts {sorted(rates.tolist())}: what it moves must "
            "decay, all of them must be < 0"
        )
    return -float(rates.max())


def error_gain_of(
    A: Numbers, B: Numbers, Q: Numbers = 1.0, error_feedback: Numbers | None = None
) -> Tensor:
    """E = B'P (m, n) for the errors' own A (n, n) - B K_e, which must be stable.

    Raises `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """
    A, B = as_float64(A, "A"), as_float64(B, "B")
    if A.dim() != 2 or A.shape[0] != A.shape[1] or B.dim() != 2 or len(B) != len(A):
        raise ShapeError(
            f"A of shape {tuple(A.shape)} and B of {tuple(B.shape)}: give (n, n) and (n, m)"
        )
    shape = B.mT.shape
    if error_feedback is not None:
        K = as_float64(error_feedback, "error_feedback")
        if K.shape != shape:
            raise ShapeError(f"error_feedback of shape {tuple(K.shape)}: give {tuple(shape)}")
        A = A - B @ K
    check_stable("A" if error_feedback is None else "A - B K_e", A)
    spd = SymmetricPositiveDefinite()
    weight = spd.coerce(as_float64(Q, "Q"), A.shape)
    if weight.shape != A.shape:
        raise ShapeError(f"Q of shape {tuple(weight.shape)}: give {tuple(A.shape)}")
    return B.mT @ lyapunov(A, spd.check("Q", weight))
