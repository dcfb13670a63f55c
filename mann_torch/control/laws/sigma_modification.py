"""sigma-modification."""

from __future__ import annotations

from torch import Tensor

from ...constraints import Finite
from ...functional import Numbers, as_float64
from .drive import Drive
from .part import Leak


class SigmaModification(Leak):
    """- Gamma sigma (theta - theta_0): a constant leak.

    `sigma` is a number or a row of N, a constant. `prior` theta_0 is (N, m) or one number, 0 if not
    given. Ioannou and Kokotovic 1983, Adaptive Systems with Reduced Models. Raises `DomainError`,
    `KindError` or `DtypeError`.
    """

    prior: Tensor | None

    def __init__(self, sigma: Numbers = 0.0, prior: Numbers | None = None) -> None:
        super().__init__()
        self.sigma: Tensor
        self.declare_rows("sigma", sigma)
        rows = None if prior is None else Finite().check("prior", as_float64(prior, "prior"))
        self.register_buffer("prior", rows)

    @property
    def center(self) -> Tensor | None:
        """theta_0 (..., N, m)."""
        return self.prior

    def forward(self, drive: Drive, estimate: Tensor) -> Tensor:
        """sigma (..., 1 or N, 1)."""
        return self.per_estimate("sigma")
