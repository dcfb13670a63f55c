"""The controller interface: torque and adaptation from reference, measurement and state."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor

from ..constraints import DesignModule
from ..types import (
    ControllerState,
    ControlOutput,
    Measurement,
    Mode,
    NetworkState,
    Proximity,
    ReferenceSample,
    TorqueGains,
)


class Controller(DesignModule):
    """Interface of every controller."""

    #: Whether `jump` can change the continuous state (reallocation).
    reallocates = False
    #: Whether its mode switches between branches whose events `proximity` compares.
    switches = False

    @abstractmethod
    def initial_network(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> NetworkState:
        """Adaptive weights at t = 0: random with a generator, else the stored ones."""

    @abstractmethod
    def initial_state(
        self, reference: ReferenceSample, measurement: Measurement, network: NetworkState
    ) -> tuple[ControllerState, Mode]:
        """Adaptive state and discrete mode at t = 0."""

    @abstractmethod
    def forward(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: Mode,
    ) -> ControlOutput:
        """Torque (..., n) [N m], time derivative of the state, and signals."""

    @abstractmethod
    def jump(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: Mode,
    ) -> tuple[ControllerState, Mode]:
        """Discrete decisions at one instant: the state after them, and the new mode."""

    def proximity(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: Mode,
    ) -> Proximity:
        """What decides the next event; asked only of a controller that `switches`."""
        raise NotImplementedError(f"{type(self).__name__} does not switch")

    def reallocate(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: Mode,
        due: Tensor,
    ) -> tuple[ControllerState, Mode]:
        """The reset that `jump` would make, in the samples `due` (...,) bool."""
        return state, mode

    def check_network(self, network: NetworkState) -> None:
        """Raise a `ConfigError` if these initial weights do not fit this controller."""
        return None

    def torque_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: ControllerState
    ) -> TorqueGains:
        """How the torque answers to position, velocity and time: what is solved implicitly.

        They may be approximate: its order does not depend on them, its stability does. Zeros
        here, which makes it an explicit method.
        """
        n = output.torque.shape[-1]
        zeros = output.torque.new_zeros((*output.torque.shape, n))
        return TorqueGains(zeros, zeros, zeros[..., 0])
