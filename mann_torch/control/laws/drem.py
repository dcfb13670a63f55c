"""Dynamic regressor extension and mixing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...constraints import Positive
from ...domains import Domain, NonNegative, NonNegativeRow
from ...errors import ConfigError
from ...functional import Numbers, as_float64, per_matrix
from ...trees import portable
from .composite import measured
from .drive import Drive
from .law import Law

#: Most estimates whose adjugate is worked out: its rounding grows with N.
MOST = 6


@portable
class Extended(NamedTuple):
    """A regression filtered until it is square."""

    Phi: Tensor  # (..., N, N)
    Y: Tensor  # (..., N, m)


class Drem(Law):
    """d theta_i/dt = gamma_i Delta (adj(Phi) Y - Delta theta)_i, Delta = det Phi.

    dPhi/dt = -lambda Phi + Phi_f Phi_f', dY/dt = -lambda Y + Phi_f y_f, both 0 at t = 0, of the
    pair that is measured: each estimate has a scalar regression of its own, and its error falls
    monotonically. `mixing_gain` gamma is a number or a row of N, `mixing_filter` lambda [1/s] a
    number, both constants. Aranovskiy et al. 2017, Performance enhancement of parameter estimators
    via dynamic regressor extension and mixing. Raises `DomainError`, `KindError`, `DtypeError`, and
    `ConfigError` for more than 6 estimates.
    """

    def __init__(self, mixing_gain: Numbers = 1.0, mixing_filter: Numbers = 1.0) -> None:
        super().__init__()
        self.mixing_gain: Tensor
        self.mixing_filter: Tensor
        rows = as_float64(mixing_gain, "mixing_gain")
        rows_domain: Domain = NonNegativeRow() if rows.dim() else NonNegative()
        self.declare("mixing_gain", rows, rows_domain, tuple(rows.shape[-1:]))
        self.declare("mixing_filter", mixing_filter, Positive())

    @property
    def needs(self) -> frozenset[str]:
        """The pair alone: no tracking error drives it."""
        return frozenset({"pair"})

    def initial_state(
        self, n_features: int, n_outputs: int, batch_shape: Sequence[int]
    ) -> Extended:
        """0. Raises `ConfigError`."""
        if n_features > MOST:
            raise ConfigError(f"DREM of {n_features} estimates: it mixes at most {MOST}")
        return Extended(
            torch.zeros(*batch_shape, n_features, n_features, dtype=torch.float64),
            torch.zeros(*batch_shape, n_features, n_outputs, dtype=torch.float64),
        )

    def forward(
        self, drive: Drive, estimate: Tensor, state: Extended, mode: Any = None
    ) -> tuple[Tensor, Extended]:
        """d theta/dt (..., N, m), and of the filters."""
        pair = measured(drive)
        adjugate, determinant = adjugate_and_determinant(state.Phi)
        missed = adjugate @ state.Y - per_matrix(determinant) * estimate
        gain = self.mixing_gain
        gain = gain.unsqueeze(-1) if self.domain("mixing_gain").event_dims else per_matrix(gain)
        pole = per_matrix(self.mixing_filter)
        rates = Extended(
            pair.regressor @ pair.regressor.mT - pole * state.Phi,
            pair.regressor @ pair.label - pole * state.Y,
        )
        return gain * per_matrix(determinant) * missed, rates


def adjugate_and_determinant(A: Tensor) -> tuple[Tensor, Tensor]:
    """adj(A) (..., n, n) and det A (...,), of singular matrices, too.

    Faddeev and LeVerrier: M_1 = I, M_(k+1) = A M_k - tr(A M_k)/k I; the signs follow from n.
    """
    n = A.shape[-1]
    eye = torch.eye(n, dtype=A.dtype)
    M = eye.expand(A.shape)
    for k in range(1, n):
        M = A @ M
        M = M - per_matrix((M * eye).sum(dim=(-2, -1)) / k) * eye
    sign = 1.0 if n % 2 else -1.0
    return sign * M, sign * ((A @ M) * eye).sum(dim=(-2, -1)) / n
