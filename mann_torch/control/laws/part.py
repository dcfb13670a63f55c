"""What laws are composed of: a gain, leaks, terms, gates and a guard."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from torch import Tensor

from ...constraints import NonNegative
from ...domains import Domain, NonNegativeRow
from ...errors import ShapeError
from ...functional import Numbers, as_float64
from .drive import Drive, product
from .keeping import Keeping


class LawPart(Keeping):
    """A mechanism of a composed law, one of the kinds below. Its contract is that of `Law`.

    State and mode are its own, as a law's are, and so are `needs`, `resets` and `jump`. With its
    constant at 0 it leaves a law as it is, bit for bit.
    """

    def declare_rows(self, name: str, value: Numbers) -> None:
        """A constant >= 0: one number for all N estimates, or a row (N,)."""
        rows = as_float64(value, name)
        width = rows.shape[-1:]
        domain: Domain = NonNegativeRow() if len(width) else NonNegative()
        self.declare(name, rows, domain, tuple(width))

    def check_width(self, n_features: int) -> None:
        """Raise `ShapeError` where a row or a matrix is not of N estimates."""
        for name, domain in self._domains.items():
            width = getattr(self, name).shape[-1:] if domain.event_dims else ()
            if width and width[0] != n_features:
                raise ShapeError(f"{name} has {width[0]} numbers: {n_features} are estimated")

    def per_estimate(self, name: str) -> Tensor:
        """Such a constant beside theta: (..., 1, 1) or (..., N, 1)."""
        value: Tensor = getattr(self, name)
        if not self._domains[name].event_dims:
            value = value.unsqueeze(-1)
        return value.unsqueeze(-1)


class Gain(LawPart):
    """The gain Gamma, or P(t), that all that moves an estimate goes through."""

    @abstractmethod
    def applied(self, x: Tensor, state: Any) -> Tensor:
        """Gamma x (..., N, m)."""

    def drive(self, drive: Drive, state: Any) -> Tensor:
        """Gamma Phi s (..., N, m)."""
        return self.applied(product(drive.regressor, drive.error), state)

    def leaked(self, rate: Tensor, coefficient: Tensor, away: Tensor, state: Any) -> Tensor:
        """rate - Gamma c theta (..., N, m), c (..., 1 or N, 1 or m)."""
        return rate - self.applied(coefficient * away, state)

    def rates(self, drive: Drive, state: Any) -> Any:
        """d state/dt."""
        return None


class GainInForce:
    """A gain with its state of one instant: what terms and guards put their own through."""

    def __init__(self, gain: Gain, state: Any) -> None:
        self.gain, self.state = gain, state

    def applied(self, x: Tensor) -> Tensor:
        """Gamma x (..., N, m)."""
        return self.gain.applied(x, self.state)


class Leak(LawPart):
    """- Gamma c (theta - center): what pulls estimates to where they are thought to be."""

    @property
    def decays(self) -> bool:
        """Whether it pulls without an error, too."""
        return True

    @property
    def center(self) -> Tensor | None:
        """Where it pulls to (..., N, m); None is 0."""
        return None

    @abstractmethod
    def forward(self, drive: Drive, estimate: Tensor) -> Tensor:
        """c >= 0 (..., 1 or N, 1 or m)."""


class Term(LawPart):
    """+ Gamma times something, with a state of its own."""

    @abstractmethod
    def forward(self, drive: Drive, estimate: Tensor, state: Any, mode: Any) -> tuple[Tensor, Any]:
        """What is added to Phi s (..., N, m), and d state/dt."""


class Gate(LawPart):
    """What of the drive is let through. It has no state."""

    @abstractmethod
    def forward(self, drive: Drive) -> Drive:
        """The drive with less of an error, or less of a `share`."""


class Guard(LawPart):
    """What has the last word on a rate. It has no state."""

    @abstractmethod
    def forward(self, rate: Tensor, estimate: Tensor, gain: GainInForce) -> Tensor:
        """The rate that is let through (..., N, m)."""
