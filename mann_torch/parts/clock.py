"""A controller that runs at instants, as one in a computer does."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..checks import NONNEGATIVE, POSITIVE, choice, number
from ..errors import ConfigError
from ..trees import map_tensors
from ..types import ClockState, ControllerTree, ControlOutput

HOLDS = ("zero", "first")


class Clock(nn.Module):
    """Ticks at `offset` + k `period` [s]: there the controller measures, adapts, decides, commands.

    Between ticks the command holds: as it is (``zero``), or on the line through the last two
    (``first``). Before the first tick it is 0. At a tick the controller's state moves over the
    period (`mann_torch.control.sampling`): by the trapezoid of its rates,

        x* = x + P r(k-1),  x+ = x + P/2 (r(k-1) + r(k, x*)),

    which is the trapezoidal rule where rates do not depend on the state (r: at that tick's
    reference and measurement), Heun's where they do; what forgets, as a memory does, by the
    exponential rule. Then its mode jumps, and the command is computed. The solver's step ends on
    every tick, whatever its size.

    Raises `ConfigError` for a period that is not > 0 or an offset that is not in [0, period),
    `KindError`.
    """

    def __init__(self, period: float, offset: float = 0.0, hold: str = "zero") -> None:
        super().__init__()
        self.period = number("clock period", period, POSITIVE)
        self.offset = number("clock offset", offset, NONNEGATIVE)
        if self.offset >= self.period:
            raise ConfigError(f"clock offset = {offset} s: must be below the period, {period} s")
        self.hold = choice("clock hold", hold, HOLDS)

    def initial_state(
        self, u: Tensor, state: ControllerTree, decay: ControllerTree = None
    ) -> ClockState:
        """Nothing commanded yet: of inputs like u (..., m), rates and decay like the state's."""
        nothing = torch.zeros_like(u)
        return ClockState(
            input=nothing,
            rates=map_tensors(torch.zeros_like, state),
            begun=torch.zeros(u.shape[:-1], dtype=torch.bool),
            slope=None if self.hold == "zero" else nothing,
            at=None if self.hold == "zero" else torch.zeros(u.shape[:-1], dtype=u.dtype),
            decay=map_tensors(torch.zeros_like, decay),
        )

    def elapsed(self, held: ClockState) -> Tensor:
        """Time since the last tick (...,) [s]: the period, 0 before the first."""
        return held.begun.to(held.input.dtype) * self.period

    def ticked(self, t: Tensor, held: ClockState, answer: ControlOutput) -> ClockState:
        """After a tick at t [s] with the controller's new answer."""
        begun, u, rates = torch.ones_like(held.begun), answer.input, answer.d_state
        if held.slope is None:
            return ClockState(u, rates, begun, decay=answer.decay)
        rise = (u - held.input) / self.period
        slope = torch.where(held.begun.unsqueeze(-1), rise, 0.0)
        return ClockState(u, rates, begun, slope, t.expand(held.begun.shape), answer.decay)

    @staticmethod
    def command(t: Tensor, held: ClockState) -> Tensor:
        """What is commanded at t [s], (..., m)."""
        if held.slope is None or held.at is None:
            return held.input
        return held.input + held.slope * (t - held.at).unsqueeze(-1)
