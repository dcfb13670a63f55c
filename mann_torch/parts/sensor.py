"""What stands between the plant and what the controller sees of it."""

from __future__ import annotations

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, POSITIVE, maybe, number
from ..constraints import DesignModule, PositiveRow
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64
from ..types import SensorState


class Sensor(DesignModule):
    """A sampling sensor: what it sees at an instant is rounded, and comes out `delay` [s] later.

    `period` [s] is the time between samples, from t = 0 on; a clock's if not given. Between them
    the last one holds. `delay` is a whole number of periods: that many samples are on their way,
    and until the first has come, it is the one at t = 0. `quantum` (Y,), or one number, is the step
    of the readings, in the measurement's units, and a constant; the gradient of a reading is that
    of the number before rounding, the mean slope of the stairs, and the step has none. Noise is a
    scenario's (`MeasurementNoise`): it is added before.

    One of one's own overrides `read`. Its contract (`mann_torch.testing.check_sensor`):

    1. `read` gives readings (..., Y) of what is seen (..., Y): a function of that and of declared
       constants alone, for any batch at once, decided by `where`, in float64. Gradients go through
       it, finite; they may be those of a smooth function beside it.
    2. Of what stands still comes out what is read of it, from t = 0 on.
    3. A constant with a batch shape gives each sample its own; other tensors are buffers.
    4. `check_fit` takes the Y numbers that it is for, `samples` the period of a clock.

    Raises `ConfigError`, `DomainError`, `ShapeError`, `KindError` or `DtypeError`.
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
        self.quantum: Tensor
        if quantum is not None:
            row = as_float64(quantum, "quantum")
            width = row.shape[-1] if row.dim() else 1
            self.declare("quantum", row, PositiveRow(), (width,))

    def check_fit(self, n_measured: int) -> None:
        """Raise `ShapeError` unless there is one quantum, or one for each number measured."""
        if "quantum" in self.domains() and self.quantum.shape[-1] not in (1, n_measured):
            raise ShapeError(
                f"sensor quantum has {self.quantum.shape[-1]} numbers: give one, or one for each "
                f"of the {n_measured} that are measured"
            )

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
        if "quantum" not in self.domains():
            return seen
        step, still = self.quantum.detach(), seen.detach()
        # The difference is 0 and has the slope 1: a reading is a multiple to the last bit.
        return torch.round(still / step) * step + (seen - still)

    def forward(self, seen: Tensor, state: SensorState) -> SensorState:
        """The state after a sample of what is seen (..., Y)."""
        newest = self.read(seen).unsqueeze(-2)
        return SensorState(torch.cat([newest, state.buffer[..., :-1, :]], dim=-2))

    @staticmethod
    def output(state: SensorState) -> Tensor:
        """What comes out, (..., Y)."""
        return state.buffer[..., -1, :]
