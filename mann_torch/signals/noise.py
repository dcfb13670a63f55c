"""Measurement noise: what the controller's sensors add to the plant's motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import POSITIVE, maybe, several, shown
from ..errors import ConfigError, KindError, ShapeError
from ..functional import Numbers, as_float64
from ..types import Measurement

#: A stream is drawn in blocks of this many numbers, so that a longer one begins as a shorter one.
BLOCK = 16


class NoiseTable(NamedTuple):
    """Unit normal numbers of R distinct seeds at K sampling instants."""

    unit: Tensor  # (R, K, 2n), q then qd
    row: Tensor  # (...,) int64, row of `unit` that a sample reads
    std: Tensor  # (..., 2) [rad], [rad/s]


def noise_at(table: NoiseTable, instants: Tensor) -> Measurement:
    """What the sensors add at sampling instants (K,) or (): each member (K, ..., n)."""
    return scaled(table.unit[:, instants].movedim(0, -2)[..., table.row, :], table.std)


def scaled(unit: Tensor, std: Tensor) -> Measurement:
    """Unit normal numbers (..., 2n) as noise of standard deviations (..., 2)."""
    n = unit.shape[-1] // 2
    return Measurement(unit[..., :n] * std[..., :1], unit[..., n:] * std[..., 1:])


class MeasurementNoise:
    """White noise on measured q and qd, from a seed a sample; the plant itself is not disturbed.

    `position_std` [rad], `velocity_std` [rad/s] and `seed` (int64) are each (...,). Samples of
    equal seed get equal noise, whatever else differs: copies to be compared share it. `rate` [Hz]
    is the sensor's: a value is held until the next; every solver step has its own if not given.

    Raises `ConfigError` for a standard deviation < 0, a seed < 0 or a rate that is not > 0,
    `ShapeError` where the shapes do not broadcast.
    """

    def __init__(
        self,
        position_std: Numbers,
        velocity_std: Numbers,
        seed: int | Sequence[int] | Tensor = 0,
        rate: float | None = None,
    ) -> None:
        std = [
            as_float64(value, name).detach()
            for name, value in (("position_std", position_std), ("velocity_std", velocity_std))
        ]
        for name, value in zip(("position_std", "velocity_std"), std, strict=True):
            if not bool((torch.isfinite(value) & (value >= 0)).all()):
                raise ConfigError(f"noise {name} = {value.tolist()}: must be finite and >= 0")
        self.rate = maybe("noise rate", rate, POSITIVE)
        try:
            seeds = torch.as_tensor(seed)
        except (TypeError, ValueError, RuntimeError, OverflowError):
            raise KindError(f"noise seed = {shown(seed)}: give whole numbers") from None
        if seeds.dtype == torch.bool or seeds.is_floating_point() or seeds.is_complex():
            raise KindError(f"noise seed = {shown(seed)}: give whole numbers >= 0")
        if bool((seeds < 0).any()):
            raise ConfigError(f"noise seed = {seeds.tolist()}: give whole numbers >= 0")
        try:
            self.position_std, self.velocity_std, self.seed = torch.broadcast_tensors(
                std[0], std[1], seeds.to(torch.int64)
            )
        except RuntimeError:
            shapes = ", ".join(str(tuple(x.shape)) for x in (*std, seeds))
            raise ShapeError(f"noise: shapes {shapes} do not broadcast") from None

    def check(self) -> None:
        """Raise, as on making, for numbers that do not fit (any more)."""
        MeasurementNoise(self.position_std, self.velocity_std, self.seed, self.rate)

    @property
    def batch_shape(self) -> torch.Size:
        """Leading batch dimensions `...`."""
        return self.seed.shape

    def expand(self, batch_shape: Sequence[int]) -> MeasurementNoise:
        """The same noise with leading batch dimensions `batch_shape`."""
        shape = tuple(batch_shape)
        return MeasurementNoise(
            self.position_std.expand(shape),
            self.velocity_std.expand(shape),
            self.seed.expand(shape),
            self.rate,
        )

    def select(self, members: Sequence[int]) -> MeasurementNoise:
        """Some members of the first batch dimension."""
        parts = (self.position_std, self.velocity_std, self.seed)
        std_q, std_qd, seed = (part[list(members)] for part in parts)
        return MeasurementNoise(std_q, std_qd, seed, self.rate)

    @staticmethod
    def stack(noises: Sequence[MeasurementNoise]) -> MeasurementNoise:
        """One noise with a new leading batch dimension. Raises `ConfigError` for unequal rates."""
        noises = several("noises", noises, MeasurementNoise)
        if len({noise.rate for noise in noises}) != 1:
            raise ConfigError("noises to stack must have the same rate")
        return MeasurementNoise(
            torch.stack([noise.position_std for noise in noises]),
            torch.stack([noise.velocity_std for noise in noises]),
            torch.stack([noise.seed for noise in noises]),
            noises[0].rate,
        )

    def instants(self, starts: Tensor) -> Tensor:
        """Number of the sampling instant in force in the steps that start at `starts` (T,) [s]."""
        if self.rate is None:
            return torch.arange(len(starts))
        return torch.floor(starts * self.rate + 1e-6).to(torch.int64)

    def table(self, n_joints: int, n_instants: int) -> NoiseTable:
        """The numbers behind the noise, each seed's once."""
        seeds, row = torch.unique(self.seed, return_inverse=True)
        width = 2 * n_joints
        count = -(-n_instants * width // BLOCK) * BLOCK
        unit = torch.empty(len(seeds), count, dtype=torch.float64)
        for stream, seed in zip(unit, seeds.tolist(), strict=True):
            torch.randn(
                count, generator=torch.Generator().manual_seed(seed), out=stream, dtype=stream.dtype
            )
        unit = unit[:, : n_instants * width].reshape(len(seeds), n_instants, width)
        return NoiseTable(unit, row, torch.stack([self.position_std, self.velocity_std], dim=-1))
