"""L1 norms of transfer functions, for the condition that an L1 controller must meet."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...constraints import PositiveRow
from ...errors import ConfigError, ShapeError
from ...functional import Numbers, as_float64
from .design import check_stable, stable_pair

#: Steps of the grid in the time of the fastest mode, and their most.
_FINE, _MOST = 32, 2_000_000
#: exp(-_DEEP) of the slowest mode is left out.
_DEEP = 32.0
_BLOCK = 512


def l1_norm(A: Numbers, B: Numbers, C: Numbers | None = None) -> Tensor:
    """Integral of |C exp(A t) B| over t >= 0, entry by entry (p, m), to about 1e-8 of each.

    Between changes of sign the integral is C A^-1 exp(A t) B, exactly; they are found on a grid
    that is fine for the fastest mode. Gradients reach the matrices. Raises `ConfigError` unless A
    is stable, or where its modes are 1e4 times apart and more; `ShapeError`, `KindError` or
    `DtypeError`.
    """
    A, B = as_float64(A, "A"), as_float64(B, "B")
    C = torch.eye(len(A), dtype=torch.float64) if C is None else as_float64(C, "C")
    if A.dim() != 2 or A.shape != (len(B), len(B)) or B.dim() != 2 or C.shape[-1:] != A.shape[:1]:
        raise ShapeError(
            f"A of shape {tuple(A.shape)}, B of {tuple(B.shape)} and C of {tuple(C.shape)}: give "
            "(d, d), (d, m) and (p, d)"
        )
    slowest = check_stable("A", A)
    dt = 1.0 / (_FINE * float(torch.linalg.eigvals(A.detach()).abs().max()))
    steps = math.ceil(_DEEP / slowest / dt)
    if steps > _MOST:
        raise ConfigError(
            f"A has modes too far apart: {steps} steps to find their impulse response"
        )
    left = C @ torch.linalg.inv(A)
    within = torch.matrix_exp(A * (dt * torch.arange(_BLOCK + 1)).reshape(-1, 1, 1))
    total = torch.zeros_like(left @ B)
    for first in range(0, steps, _BLOCK):
        # The block's starts are computed by one exponential each: no error adds up.
        state = within @ (torch.matrix_exp(A * (dt * first)) @ B)
        total = total + _block(A, B, C @ state, left @ state, left, state, dt)
    return total


def _block(
    A: Tensor, B: Tensor, h: Tensor, whole: Tensor, left: Tensor, state: Tensor, dt: float
) -> Tensor:
    """Integral of |h| over the block's steps: impulse response h and its integral (T, p, m)."""
    before, after = h[:-1], h[1:]
    part = (whole[1:] - whole[:-1]).abs()
    change = before * after < 0
    for step, row, column in change.nonzero().tolist():
        # Where h changes its sign on the line; being off by d costs no more than h' d^2.
        b, a = float(before[step, row, column]), float(after[step, row, column])
        there = torch.matrix_exp(A * (dt * b / (b - a))) @ state[step, :, column]
        middle = left[row] @ there
        pieces = (middle - whole[step, row, column]).abs() + (
            whole[step + 1, row, column] - middle
        ).abs()
        part = part.clone()
        part[step, row, column] = pieces
    return part.sum(0)


def l1_gain(A_m: Numbers, B: Numbers, bandwidth: Numbers) -> Tensor:
    """L1 norm of (s - A_m)^-1 B (1 - C), C = w_c / (s + w_c) of an input each, (d, m).

    Where theta of u + theta'x has |theta|_1 <= L, the loop is stable if L times the largest row sum
    is below 1: Hovakimyan and Cao, L1 Adaptive Control Theory, 2010, section 2.2. Raises as
    `l1_norm` and `L1Adaptive`.
    """
    A, b = stable_pair(A_m, B)
    w = as_float64(bandwidth, "bandwidth")
    w = PositiveRow().check("bandwidth", w.expand(b.shape[1]) if w.dim() == 0 else w)
    if w.shape != b.shape[1:]:
        raise ShapeError(f"bandwidth of shape {tuple(w.shape)}: give {b.shape[1]} numbers")
    # x' = A_m x + B (v - z), z' = w (v - z): what of v the filter leaves.
    filter_ = torch.diag(w)
    top = torch.cat([A, -b], dim=-1)
    bottom = torch.cat([torch.zeros_like(b.mT), -filter_], dim=-1)
    seen = torch.eye(len(A), len(A) + len(w), dtype=A.dtype)
    return l1_norm(torch.cat([top, bottom]), torch.cat([b, filter_]), seen)
