"""What drives an estimate."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor


class Pair(NamedTuple):
    """A regression that is measured: label = Phi' theta* for the theta* that is sought."""

    regressor: Tensor  # (..., N, r) Phi
    label: Tensor  # (..., r, m) y


class Drive(NamedTuple):
    """What drives an estimate theta (..., N, m): u = Phi' theta, d theta/dt = Phi s and more.

    Of features phi (..., N) r is 1, and every output has an error of its own; a regressor Y of
    mechanics (..., n, N) is Phi = Y', its estimate one column. All that a controller knows is here;
    what a law asks for beyond regressor and error it names in `needs`. It has no time: what changes
    with it is a state of the law's own.
    """

    regressor: Tensor  # (..., N, r) Phi
    error: Tensor  # (..., r, m) s
    error_norm: Tensor  # (...,) of the tracking error e
    excess: Tensor | None = None  # (..., m) sat(u) - u where the input is limited
    pair: Pair | None = None  # a regression that is measured
    shortfall: Tensor | None = None  # (..., m) u - Phi' theta: what feedback had to add
    share: Tensor | None = None  # (...,) of all motion that gates let through, None: all

    @classmethod
    def of_features(
        cls,
        features: Tensor,
        error: Tensor,
        error_norm: Tensor,
        excess: Tensor | None = None,
        pair: Pair | None = None,
        shortfall: Tensor | None = None,
    ) -> Drive:
        """Of features phi (..., N) and errors s (..., m)."""
        return cls(features.unsqueeze(-1), error.unsqueeze(-2), error_norm, excess, pair, shortfall)


def product(regressor: Tensor, error: Tensor) -> Tensor:
    """Phi s: (..., N, r), (..., r, m) -> (..., N, m)."""
    return regressor * error if regressor.shape[-1] == 1 else regressor @ error
