"""The interface of what protects adaptation from a limited input."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ...constraints import DesignModule
from ...interface import Interface


class Saturation(Interface, DesignModule):
    """What a controller does about an input that is limited.

    Its contract: `n_states` n, None for any, and `n_inputs` m say its sizes. State is a NamedTuple
    of its own, or None, that flows by `rates`. e_d is what of the tracking error the limits are to
    blame for, None for nothing: the controller's error is x_m + e_d - x. While u is within the
    limits e_d stays 0 and `command` is u, bit for bit. The limits themselves are the plant's or an
    `Actuator`'s; this knows them only.
    """

    n_states: int | None
    n_inputs: int

    @property
    @abstractmethod
    def limit(self) -> Tensor:
        """The largest |u| that is applied (..., m)."""

    @abstractmethod
    def initial_state(self, batch_shape: Sequence[int]) -> Any:
        """State at t = 0."""

    @abstractmethod
    def error(self, state: Any) -> Tensor | None:
        """e_d (..., n), or None."""

    @abstractmethod
    def rates(self, state: Any, drive: Tensor, excess: Tensor) -> Any:
        """d state/dt, for an error s (..., m) and an excess (..., m)."""

    def command(self, wanted: Tensor) -> Tensor:
        """What is asked of the actuator (..., m), where the law wants u (..., m)."""
        return wanted

    def slope(self, wanted: Tensor) -> Tensor:
        """d command / d u (..., m), for the implicit solver."""
        return torch.ones_like(wanted)

    def excess(self, wanted: Tensor) -> Tensor:
        """sat(command) - u (..., m): what is lacking, 0 within the limits."""
        limit = self.limit
        asked = self.command(wanted)
        # Not u - u: 0 to the last bit, and a gradient of 0, where nothing is cut.
        return torch.maximum(torch.minimum(asked, limit), -limit) - wanted
