"""What stands between the plant and what the controller sees of it."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..checks import NONNEGATIVE, POSITIVE, maybe, number
from ..constraints import PositiveRow
from ..errors import ConfigError
from ..functional import Numbers, as_float64
from ..types import SensorState


class Sensor(nn.Module):
    """A sampling sensor: what it sees at an instant is rounded, and comes out `delay` [s] later.

    `period` [s] is the time between samples, from t = 0 on; a clock's if not given. Between them
    the last one holds. `delay` is a whole number of periods: that many samples are on their way,
    and until the first has come, it is the one at t = 0. `quantum` (Y,), or one number, is the step
    of the readings, in the measurement's units; its gradient is that of the number before rounding,
    the mean slope of the stairs. Noise is a scenario's (`MeasurementNoise`): it is added before.

    Raises `ConfigError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        quantum: Numbers | None = None,
        delay: float = 0.0,
        period: float | None = None,
    ) -> None:
        super().__init__()
        self.period = maybe("sensor period", period, POSITIVE)
        self.delay = number("sensor delay", delay, NONNEGATIVE)
        self.quantum: Tensor | None
        rows = None
        if quantum is not None:
            rows = PositiveRow().check("sensor quantum", as_float64(quantum, "sensor quantum"))
        self.register_buffer("quantum", rows)

    def samples(self, clock_period: float | None) -> tuple[float, int]:
        """Time between samples [s], and how many are on their way. Raises `ConfigError`."""
        period = clock_period if self.period is None else self.period
        if period is None:
            raise ConfigError("sensor: give it a period [s], or the loop a clock")
        count = round(self.delay / period)
        if abs(count * period - self.delay) > 1e-6 * period:
            raise ConfigError(
                f"sensor delay = {self.delay} s: must be a whole number of periods ({period} s)"
            )
        if count > 100_000:
            raise ConfigError(f"sensor delay = {self.delay} s: over 100000 periods ({period} s)")
        return period, count

    def initial_state(self, seen: Tensor, count: int) -> SensorState:
        """All samples the first: of readings (..., Y)."""
        first = self.read(seen).unsqueeze(-2)
        return SensorState(first.expand(*seen.shape[:-1], count + 1, seen.shape[-1]))

    def read(self, seen: Tensor) -> Tensor:
        """Readings (..., Y) of what is seen."""
        if self.quantum is None:
            return seen
        rounded = torch.round(seen.detach() / self.quantum) * self.quantum
        return seen + (rounded - seen).detach()

    def forward(self, seen: Tensor, state: SensorState) -> SensorState:
        """The state after a sample of what is seen (..., Y)."""
        newest = self.read(seen).unsqueeze(-2)
        return SensorState(torch.cat([newest, state.buffer[..., :-1, :]], dim=-2))

    @staticmethod
    def output(state: SensorState) -> Tensor:
        """What comes out, (..., Y)."""
        return state.buffer[..., -1, :]
