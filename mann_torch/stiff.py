"""Stiff blocks: what the implicit solver treats implicitly of a loop."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .functional import solve_small, times_column


class SecondOrderBlock(NamedTuple):
    """Of a mechanical plant: d(qdd) = -stiffness dq - damping d(qd) + drift dt.

    The state begins with q and qd, so that a solve is n x n, not 2n x 2n.
    """

    stiffness: Tensor  # (..., n, n) [1/s^2]
    damping: Tensor  # (..., n, n) [1/s]
    drift: Tensor  # (..., n) [rad/s^3]

    def damped(self, rate: Tensor, gh: Tensor, sign: float) -> Tensor:
        """(I - g h A)^-1 (rate + sign g h T), (..., M); gh is (..., 1).

        (I + gh P + gh^2 K) k_v = f_v + sign gh T - gh K f_q; k_q = f_q + gh k_v.
        """
        n = self.damping.shape[-1]
        f_q, f_v, rest = rate[..., :n], rate[..., n : 2 * n], rate[..., 2 * n :]
        eye = torch.eye(n, dtype=rate.dtype, device=rate.device)
        wide = gh.unsqueeze(-1)
        matrix = eye + wide * (self.damping + wide * self.stiffness)
        right = f_v - gh * times_column(self.stiffness, f_q)
        if sign:
            push = gh * self.drift
            right = right + (push if sign > 0 else -push)
        k_v = solve_small(matrix, right.unsqueeze(-1)).squeeze(-1)
        return torch.cat([f_q + gh * k_v, k_v, rest], dim=-1)

    def answer(self, change: Tensor) -> Tensor:
        """d(qdd) (..., n) to a change of the state (..., M)."""
        n = self.damping.shape[-1]
        q, v = change[..., :n], change[..., n : 2 * n]
        return -(times_column(self.stiffness, q) + times_column(self.damping, v))


class FirstOrderBlock(NamedTuple):
    """Of any plant: d(dx/dt) = jacobian dx + drift dt, where the state begins with x."""

    jacobian: Tensor  # (..., L, L) [1/s]
    drift: Tensor  # (..., L)

    def damped(self, rate: Tensor, gh: Tensor, sign: float) -> Tensor:
        """(I - g h A)^-1 (rate + sign g h T), (..., M); gh is (..., 1)."""
        width = self.jacobian.shape[-1]
        head, rest = rate[..., :width], rate[..., width:]
        eye = torch.eye(width, dtype=rate.dtype, device=rate.device)
        matrix = eye - gh.unsqueeze(-1) * self.jacobian
        if sign:
            head = head + sign * gh * self.drift
        solved = solve_small(matrix, head.unsqueeze(-1)).squeeze(-1)
        return torch.cat([solved, rest], dim=-1)

    def answer(self, change: Tensor) -> Tensor:
        """d(dx/dt) (..., L) to a change of the state (..., M)."""
        return times_column(self.jacobian, change[..., : self.jacobian.shape[-1]])


StiffBlock = SecondOrderBlock | FirstOrderBlock
