"""Continuous least squares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...constraints import NonNegative, Positive, SymmetricPositiveDefinite
from ...functional import Numbers, as_float64, per_matrix
from ...trees import portable
from .drive import Drive, product
from .part import Gain


@portable
class Covariance(NamedTuple):
    """What least squares keeps."""

    P: Tensor  # (..., N, N), shared by all columns of estimates


class LeastSquares(Gain):
    """d theta/dt = P Phi s/m^2, dP/dt = forgetting P - P Phi Phi' P/m^2.

    m^2 = 1 + nu tr(Phi' Phi). Constants: `initial_gain` P(0), a number times I, a row of N (its
    diagonal) or an SPD matrix (N, N); `forgetting` [1/s]; `gain_normalisation` nu, at 0 m is 1.
    With `gain_bound` k forgetting is multiplied by 1 - |P|/k, of the Frobenius norm, which stays
    below k where it starts there. With `reset_at`, P is put back to P(0) where tr P/N has fallen
    to it. What freezes estimates freezes P. Slotine and Li, Applied Nonlinear Control, 8.7; Ioannou
    and Sun, Robust Adaptive Control, 4.3. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        initial_gain: Numbers = 1.0,
        forgetting: Numbers = 0.0,
        gain_normalisation: Numbers = 0.0,
        gain_bound: Numbers | None = None,
        reset_at: Numbers | None = None,
    ) -> None:
        super().__init__()
        self.initial_gain: Tensor
        self.forgetting: Tensor
        self.gain_normalisation: Tensor
        self.gain_bound: Tensor
        self.reset_at: Tensor
        value = as_float64(initial_gain, "initial_gain")
        if value.dim() == 2:
            self.declare("initial_gain", value, SymmetricPositiveDefinite(), tuple(value.shape))
        else:
            self.declare_rows("initial_gain", value)
        self.declare("forgetting", forgetting, NonNegative())
        self.declare("gain_normalisation", gain_normalisation, NonNegative())
        self.bounded, self.restarts = gain_bound is not None, reset_at is not None
        if gain_bound is not None:
            self.declare("gain_bound", gain_bound, Positive())
        if reset_at is not None:
            self.declare("reset_at", reset_at, Positive())

    @property
    def resets(self) -> bool:
        """Whether P is put back to P(0)."""
        return self.restarts

    def initial_state(
        self, n_features: int, n_outputs: int, batch_shape: Sequence[int]
    ) -> Covariance:
        """P(0)."""
        first = self._first(torch.eye(n_features, dtype=torch.float64))
        return Covariance(first.expand(*batch_shape, n_features, n_features))

    def applied(self, x: Tensor, state: Covariance) -> Tensor:
        """P x (..., N, m)."""
        return state.P @ x

    def drive(self, drive: Drive, state: Covariance) -> Tensor:
        """P Phi s/m^2 (..., N, m)."""
        return product(state.P @ drive.regressor, drive.error / per_matrix(self._size(drive)))

    def rates(self, drive: Drive, state: Covariance) -> Covariance:
        """dP/dt."""
        P = state.P
        along = P @ drive.regressor
        forgetting = self.forgetting
        if self.bounded:
            size = P.square().sum(dim=(-2, -1)).sqrt()
            forgetting = forgetting * (1.0 - size / self.gain_bound)
        rate = per_matrix(forgetting) * P - along @ along.mT / per_matrix(self._size(drive))
        return Covariance(rate if drive.share is None else per_matrix(drive.share) * rate)

    def jump(
        self, drive: Drive, estimate: Tensor, state: Covariance, mode: Any
    ) -> tuple[Covariance, Any]:
        """P(0) where P has become too small."""
        if not self.restarts:
            return state, mode
        n = state.P.shape[-1]
        eye = torch.eye(n, dtype=state.P.dtype)
        small = (state.P * eye).sum(dim=(-2, -1)) / n <= self.reset_at
        return Covariance(torch.where(per_matrix(small), self._first(eye), state.P)), mode

    def _first(self, eye: Tensor) -> Tensor:
        """P(0) (..., N, N)."""
        if self._domains["initial_gain"].event_dims == 2:
            return self.initial_gain
        return self.per_estimate("initial_gain") * eye

    def _size(self, drive: Drive) -> Tensor:
        """m^2 (...,)."""
        return 1.0 + self.gain_normalisation * drive.regressor.square().sum(dim=(-2, -1))
