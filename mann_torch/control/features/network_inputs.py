"""What an adaptive network sees of the loop."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import torch
from torch import Tensor, nn

from ...checks import whole
from ...interface import Interface
from ...types import ReferenceSample, TrackingError


class NetworkInputs(Interface, nn.Module):
    """Interface of an input vector x~ (..., I). `rate_from` is the place of de/dt in it, or None.

    The implicit solver then counts how the network's output answers to velocities.
    """

    width: int
    #: Derivatives of the reference that it reads.
    reference_order: int = 1
    rate_from: int | None = None

    @abstractmethod
    def forward(
        self, tracking: TrackingError, reference: ReferenceSample, measurement: Any
    ) -> Tensor:
        """x~ (..., I)."""


class ErrorsAndReference(NetworkInputs):
    """The paper's choice: x~ = [e de s ds dds], I = 5n. Raises `ConfigError`, `KindError`."""

    reference_order = 2

    def __init__(self, n_joints: int) -> None:
        super().__init__()
        n_joints = whole("n_joints", n_joints)
        self.width, self.rate_from = 5 * n_joints, n_joints

    def forward(
        self, tracking: TrackingError, reference: ReferenceSample, measurement: Any
    ) -> Tensor:
        """(..., 5n)."""
        s, ds, dds = reference.upto(2)
        return torch.cat([tracking.error, tracking.error_rate, s, ds, dds], dim=-1)


class Measured(NetworkInputs):
    """What is measured, all numbers of it, I = `width`. Raises `ConfigError`, `KindError`."""

    reference_order = 0

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = whole("width", width)

    def forward(
        self, tracking: TrackingError, reference: ReferenceSample, measurement: Any
    ) -> Tensor:
        """(..., Y)."""
        return torch.cat(list(measurement), dim=-1)
