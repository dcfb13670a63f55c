"""mu-modification."""

from __future__ import annotations

import torch
from torch import Tensor

from ...constraints import NonNegative, Positive
from ...errors import DomainError
from ...functional import Numbers
from .learned_deficit import LearnedDeficit


class MuModification(LearnedDeficit):
    """u_c = u within L = limit - margin, else (u + mu sat_L(u)) / (1 + mu): it shrinks from limits.

    The deficit sat(u_c) - u moves e_d by an effect that is learned, as in `LearnedDeficit`.
    Constants beside its: `mu`, and `limit_margin` in the input's units. Lavretsky and Hovakimyan
    2007, Stable adaptation in the presence of input constraints. Raises `DomainError` where the
    margin is no less than a limit, `ShapeError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        A: Numbers,
        B: Numbers,
        input_limit: Numbers,
        mu: Numbers = 1.0,
        limit_margin: Numbers = 0.1,
        deficit_rate: Numbers = 1.0,
        start: Numbers = 0.0,
    ) -> None:
        super().__init__(A, B, input_limit, deficit_rate, start)
        self.mu: Tensor
        self.limit_margin: Tensor
        self.declare("mu", mu, NonNegative())
        self.declare("limit_margin", limit_margin, Positive())
        self.check()

    def check_together(self) -> None:
        """Raise `DomainError` where nothing is left within the margin."""
        if bool((self._inner() <= 0).any()):
            margin, limit = self.limit_margin.tolist(), self.input_limit.tolist()
            raise DomainError(
                f"limit_margin = {margin} with input_limit = {limit}: the margin must be less than "
                "each limit"
            )

    def _inner(self) -> Tensor:
        return self.input_limit - self.limit_margin.unsqueeze(-1)

    def command(self, wanted: Tensor) -> Tensor:
        """u_c (..., m)."""
        inner, mu = self._inner(), self.mu.unsqueeze(-1)
        shrunk = (wanted + mu * torch.sign(wanted) * inner) / (1.0 + mu)
        return torch.where(wanted.abs() <= inner, wanted, shrunk)

    def slope(self, wanted: Tensor) -> Tensor:
        """1, or 1 / (1 + mu)."""
        shrunk = (1.0 / (1.0 + self.mu)).unsqueeze(-1)
        return torch.where(wanted.abs() <= self._inner(), 1.0, shrunk)
