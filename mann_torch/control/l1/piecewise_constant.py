"""The piecewise-constant law of L1 adaptive control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ...functional import pick, times_column
from ...trees import portable
from ..timing import due, running, started
from .adaptation import Estimated, L1Adaptation


@portable
class Watch(NamedTuple):
    """Its state."""

    elapsed: Tensor  # (...,) [s]


@portable
class Sampled(NamedTuple):
    """Its mode."""

    sigma: Tensor  # (..., d) in force
    taken: Tensor  # (...,) int64, samples so far


class PiecewiseConstant(L1Adaptation):
    """sigma^(k) = -B+^-1 Phi^-1 exp(A_m T) x~(kT), Phi = integral of exp(A_m s) over a period T.

    B+ = [B, N] with orthonormal columns N across B: the first m of sigma^ are matched, the others
    push the predictor alone. What is constant is found by the first sample, up to exp(A_m T).
    Source: Hovakimyan and Cao, L1 Adaptive Control Theory, 2010, section 3.3.
    """

    def __init__(self, A_m: Tensor, B: Tensor, period: float) -> None:
        super().__init__()
        self.period, (d, self.n_inputs) = period, B.shape
        across = torch.linalg.svd(B).U[:, self.n_inputs :]
        whole = torch.cat([B, across], dim=-1)
        # The exponential of [[A, 1], [0, 0]] T holds exp(A T) and Phi.
        block = torch.zeros(2 * d, 2 * d, dtype=A_m.dtype)
        block[:d, :d], block[:d, d:] = A_m, torch.eye(d, dtype=A_m.dtype)
        flow = torch.matrix_exp(block * period)
        gain = -torch.linalg.solve(flow[:d, d:] @ whole, flow[:d, :d])
        self.whole: Tensor
        self.gain: Tensor
        self.register_buffer("whole", whole)
        self.register_buffer("gain", gain)

    @property
    def periods(self) -> tuple[float, ...]:
        """T [s]."""
        return (self.period,)

    def initial_state(self, batch_shape: Sequence[int]) -> tuple[Watch, Sampled]:
        """Nothing sampled yet."""
        elapsed, taken = started(batch_shape)
        sigma = torch.zeros(*batch_shape, len(self.whole), dtype=torch.float64)
        return Watch(elapsed), Sampled(sigma, taken)

    def forward(self, x: Tensor, state: Watch, mode: Sampled) -> Estimated:
        """sigma^ of the last sample."""
        return Estimated(times_column(self.whole, mode.sigma), mode.sigma[..., : self.n_inputs])

    def rates(self, x: Tensor, error: Tensor, state: Watch, mode: Sampled) -> Watch:
        """The watch runs."""
        return Watch(running(state.elapsed))

    def jump(self, x: Tensor, error: Tensor, state: Watch, mode: Sampled) -> tuple[Watch, Sampled]:
        """A sample, where one is due."""
        now = due(state.elapsed, mode.taken, self.period)
        sigma = pick(now, times_column(self.gain, error), mode.sigma)
        return state, Sampled(sigma, mode.taken + now.to(torch.int64))
