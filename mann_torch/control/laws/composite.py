"""Composite adaptation."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from ...errors import ConfigError
from ...functional import Numbers
from .drive import Drive, Pair, product
from .part import Term


class Composite(Term):
    """+ Gamma Phi_f R (y_f - Phi_f' theta): the prediction error of a measured pair drives, too.

    `composite_gain` R is a number or a row (r,), one number for each row of a label. Slotine and Li
    1989, Composite adaptive control of robot manipulators. Raises `DomainError`, `KindError` or
    `DtypeError`.
    """

    def __init__(self, composite_gain: Numbers = 0.0) -> None:
        super().__init__()
        self.composite_gain: Tensor
        self.declare_rows("composite_gain", composite_gain)

    @property
    def needs(self) -> frozenset[str]:
        """The pair."""
        return frozenset({"pair"})

    @property
    def rows(self) -> int | None:
        """Of a row R."""
        return self.composite_gain.shape[-1] if self.domain("composite_gain").event_dims else None

    def check_width(self, n_features: int) -> None:
        """Nothing: R is of the rows of a pair."""

    def forward(self, drive: Drive, estimate: Tensor, state: Any, mode: Any) -> tuple[Tensor, Any]:
        """Phi_f R (y_f - Phi_f' theta) (..., N, m)."""
        pair = measured(drive)
        missed = pair.label - pair.regressor.mT @ estimate
        return product(pair.regressor, self.per_estimate("composite_gain") * missed), None


def measured(drive: Drive) -> Pair:
    """The pair of a drive that should have one. Raises `ConfigError`."""
    if drive.pair is None:
        raise ConfigError("the law needs a measured pair, which what drives it does not hold")
    return drive.pair
