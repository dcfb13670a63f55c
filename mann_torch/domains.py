"""Sets of values that a design constant or a plant's parameter may take."""

from __future__ import annotations

from abc import abstractmethod

import torch
from torch import Tensor

from .errors import DomainError
from .interface import Interface


class Domain(Interface):
    """The set of values a constant may take. `event_dims` trailing dimensions form one value."""

    event_dims = 0
    text = ""

    @abstractmethod
    def contains(self, value: Tensor) -> bool:
        """Whether every (batched) value lies in the domain; NaN and inf never do."""

    def coerce(self, value: Tensor, event_shape: torch.Size) -> Tensor:
        """Write a short form of a value out in full; the plain domains have none."""
        return value

    def project_gradient(self, gradient: Tensor) -> Tensor:
        """The part of a gradient along which a value may move."""
        return gradient

    def check(self, name: str, value: Tensor) -> Tensor:
        """Return `value`, or raise `DomainError` naming the constant and its domain."""
        if value.is_meta:  # a module built without storage has no values yet
            return value
        if not bool(torch.isfinite(value).all()) or not self.contains(value):
            shown = value.detach().tolist()
            raise DomainError(f"{name} = {shown} is outside its domain: must be {self.text}")
        return value


class Positive(Domain):
    """Finite and > 0."""

    text = "finite and > 0"

    def contains(self, value: Tensor) -> bool:
        return bool((value > 0).all())


class Finite(Domain):
    """Any finite number."""

    text = "finite"

    def contains(self, value: Tensor) -> bool:
        return True


class NonNegative(Domain):
    """Finite and >= 0."""

    text = "finite and >= 0"

    def contains(self, value: Tensor) -> bool:
        return bool((value >= 0).all())


class Row(Domain):
    """A row (..., n) of numbers; one number stands for n of them."""

    event_dims = 1

    def coerce(self, value: Tensor, event_shape: torch.Size) -> Tensor:
        """A scalar stands for a whole row."""
        return value.expand(event_shape) if value.dim() == 0 else value


class FiniteRow(Row, Finite):
    """n finite numbers."""


class NonNegativeRow(Row, NonNegative):
    """n numbers, finite and >= 0."""


class PositiveRow(Row, Positive):
    """n numbers, finite and > 0."""


class SymmetricPositiveDefinite(Domain):
    """Symmetric positive definite matrix (..., n, n)."""

    event_dims = 2
    text = "a symmetric positive definite matrix"

    def coerce(self, value: Tensor, event_shape: torch.Size) -> Tensor:
        """A scalar stands for a multiple of the identity, a list of n for a diagonal matrix."""
        if value.dim() == 0:
            return value * torch.eye(event_shape[-1], dtype=value.dtype)
        return torch.diag_embed(value) if value.shape == event_shape[-1:] else value

    def project_gradient(self, gradient: Tensor) -> Tensor:
        """The symmetric part, so that an optimizer's step keeps the matrix symmetric."""
        return 0.5 * (gradient + gradient.mT)

    def contains(self, value: Tensor) -> bool:
        if not torch.allclose(value, value.mT, rtol=1e-12, atol=1e-12):
            return False
        return bool((torch.linalg.eigvalsh(value) > 0).all())
