"""Loops that are not the paper's: a tank of one field, controllers of a few lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import Controller
from mann_torch.domains import Positive
from mann_torch.plants import Field, Plant
from mann_torch.signals import PiecewiseConstant, Sinusoid
from mann_torch.types import Channel, ControlOutput


class TankState(NamedTuple):
    error: Tensor  # (..., 1) level: named as the loop's own error is
    t: Tensor  # (..., 1) temperature: named as time is


class TankParameters(NamedTuple):
    area: Tensor  # (..., 1)


_FIELDS = {"area": Field((1.0,), Positive(), "m^2")}


class Tank(Plant):
    """area dh/dt = u - h, and a temperature that follows the level."""

    Parameters = TankParameters
    fields = _FIELDS
    inputs = (Channel("inflow", "m^3/s"),)
    outputs = (Channel("level", "m"),)

    def rest(self) -> TankState:
        return TankState(*torch.zeros(2, 1, dtype=torch.float64))

    def derivative(
        self, t: Tensor, state: TankState, input: Any, disturbance: Any, coefficients: Any
    ) -> TankState:
        level, warmth = state
        return TankState((input.u - level) / coefficients.area, level - warmth)

    def output(self, state: TankState, coefficients: Any) -> Tensor:
        return state.error


class Levelling(Controller):
    """u = 9 (r - level), and nothing to tell of it."""

    def initial_state(
        self, reference: Any, measurement: Any, batch_shape: Sequence[int], *given: Any, **more: Any
    ) -> tuple[Any, Any]:
        return None, None

    def forward(self, reference: Any, measurement: Any, state: Any, mode: Any) -> ControlOutput:
        u = 9.0 * (reference.value - measurement.error)
        return ControlOutput(u, None, None)


class Gains(NamedTuple):
    k: Tensor  # (..., 2)
    grid: Tensor  # (..., 10, 20): too large to be kept


class Told(NamedTuple):
    k: Tensor  # named as a part of the state is
    rate: Tensor  # (1,), the same at all times
    nothing: None


class Adapting(Levelling):
    """u = k_1 (r - level) + k_2, both adapted by the error."""

    def initial_state(
        self, reference: Any, measurement: Any, batch_shape: Sequence[int], *given: Any, **more: Any
    ) -> tuple[Any, Any]:
        ones = (torch.ones(*batch_shape, *event, dtype=torch.float64) for event in ((2,), (10, 20)))
        return Gains(*ones), None

    def forward(self, reference: Any, measurement: Any, state: Any, mode: Any) -> ControlOutput:
        error, rate = reference.value - measurement.error, error_rate()
        u = state.k[..., :1] * error + state.k[..., 1:]
        slope = rate * error * torch.cat([error, torch.ones_like(error)], dim=-1)
        told = Told(state.k[..., :1], rate, None)
        return ControlOutput(u, Gains(slope, torch.zeros_like(state.grid)), told)


def error_rate() -> Tensor:
    """How fast gains adapt."""
    return torch.tensor([3.0], dtype=torch.float64)


def tank(controller: Controller, **parts: Any) -> tuple[mt.ClosedLoop, mt.Scenario]:
    """Half a second in a tank whose area doubles at 0.2 s."""
    plant = Tank()
    area = PiecewiseConstant([0.2], torch.tensor([[1.0], [2.0]], dtype=torch.float64))
    reference = Sinusoid([1.0], 0.7, 0.5)
    scenario = mt.Scenario(reference, plant.parameters_of(), 0.5, {"area": area})
    return mt.ClosedLoop(plant, controller, **parts), scenario


def short(loop: mt.ClosedLoop, scenario: mt.Scenario) -> mt.Trajectory:
    """Two draws by the torch engine."""
    with torch.no_grad():
        return mt.rollout(
            loop, scenario, mt.Implicit(0.01), batch_shape=(2,), engine="torch", sample_dt=0.05
        )
