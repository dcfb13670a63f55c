"""L1 norms of transfer functions, for the condition that an L1 controller must meet."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...constraints import PositiveRow
from ...errors import ConfigError, ShapeError
from ...functional import Numbers, as_float64
from ..lyapunov import check_stable
from .design import stable_pair

#: Steps of the grid in the time of the fastest mode, and their most.
_FINE, _MOST = 32, 2_000_000
#: exp(-_DEEP) of the slowest mode is left out.
_DEEP = 32.0
_BLOCK = 512


def l1_norm(A: Numbers, B: Numbers, C: Numbers | None = None) -> Tensor:
    """Integral of |C exp(A t) B| over t >= 0, entry by entry (p, m), to about 1e-10 of each.

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
    within = _flow(A, dt * torch.arange(_BLOCK + 1, dtype=A.dtype))
    total = torch.zeros_like(left @ B)
    for first in range(0, steps, _BLOCK):
        # The block's starts are computed by one exponential each: no error adds up.
        state = within @ (torch.matrix_exp(A * (dt * first)) @ B)
        total = total + _block(A, C, left, state, dt)
    return total


def _block(A: Tensor, C: Tensor, left: Tensor, state: Tensor, dt: float) -> Tensor:
    """Integral of |h| over the steps between states exp(A t) B (T + 1, d, m)."""
    h, whole = C @ state, left @ state
    parts = (whole[1:] - whole[:-1]).abs()
    places = (h[:-1] * h[1:] < 0).nonzero()
    if not len(places):
        return parts.sum(0)
    step, row, column = places.unbind(-1)
    begin = state[step, :, column]
    time = _crossings(A, C[row], begin, h[step, row, column], h[step + 1, row, column], dt)
    middle = (left[row] * (_flow(A, time) @ begin.unsqueeze(-1))[..., 0]).sum(-1)
    ends = whole[step, row, column], whole[step + 1, row, column]
    pieces = (middle - ends[0]).abs() + (ends[1] - middle).abs()
    return parts.index_put((step, row, column), pieces).sum(0)


@torch.no_grad()
def _crossings(
    A: Tensor, C: Tensor, begin: Tensor, before: Tensor, after: Tensor, dt: float
) -> Tensor:
    """Times (R,) after `begin` (R, d) at which C exp(A t) begin is 0: on the line, then Newton."""
    time = dt * before / (before - after)
    for _ in range(3):
        there = (_flow(A, time) @ begin.unsqueeze(-1))[..., 0]
        value, slope = (C * there).sum(-1), (C * (there @ A.mT)).sum(-1)
        ahead = time - value / slope
        time = torch.where((ahead >= 0) & (ahead <= dt), ahead, time)
    return time


def _flow(A: Tensor, time: Tensor) -> Tensor:
    """exp(A t) (R, d, d)."""
    return torch.matrix_exp(A * time.reshape(-1, 1, 1))


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
