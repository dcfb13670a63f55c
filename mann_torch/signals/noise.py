"""Measurement noise: what the controller's sensors add to the plant's motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import POSITIVE, maybe, several, shown
from ..errors import ConfigError, KindError, ShapeError
from ..functional import Numbers, as_float64

#: A stream is drawn in blocks of this many numbers, so that a longer one begins as a shorter one.
BLOCK = 16


class NoiseTable(NamedTuple):
    """Unit normal numbers of R distinct seeds at K sampling instants."""

    unit: Tensor  # (R, K, Y), a number for each of the measurement's
    row: Tensor  # (...,) int64, row of `unit` that a sample reads
    std: Tensor  # (..., Y), in the measurement's units


def noise_at(table: NoiseTable, instants: Tensor) -> Tensor:
    """What the sensors add at sampling instants (K,) or (): (K, ..., Y)."""
    return table.unit[:, instants].movedim(0, -2)[..., table.row, :] * table.std


class MeasurementNoise:
    """White noise on what is measured, from a seed a sample; the plant itself is not disturbed.

    `std` (..., F) are standard deviations, one for each field of the plant's measurement (of a
    mechanical plant: positions, velocities) or one for each number in it, in its units. `seed`
    (...,) int64: samples of equal seed get equal noise, whatever else differs, so that copies to be
    compared share it. `rate` [Hz] is the noise's: a value is held until the next; every solver step
    has its own if not given.

    Raises `ConfigError` for a standard deviation < 0, a seed < 0 or a rate that is not > 0,
    `ShapeError` where the shapes do not broadcast, `KindError`, `DtypeError`.
    """

    def __init__(
        self, std: Numbers, seed: int | Sequence[int] | Tensor = 0, rate: float | None = None
    ) -> None:
        given = as_float64(std, "noise std").detach()
        if given.dim() < 1:
            raise ShapeError("noise std: give a row, one a field or a number of the measurement")
        if not bool((torch.isfinite(given) & (given >= 0)).all()):
            raise ConfigError(f"noise std = {given.tolist()}: must be finite and >= 0")
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
            batch = torch.broadcast_shapes(given.shape[:-1], seeds.shape)
        except RuntimeError:
            shapes = f"std {tuple(given.shape)}, seed {tuple(seeds.shape)}"
            raise ShapeError(f"noise: shapes {shapes} do not broadcast") from None
        self.std = given.expand(*batch, given.shape[-1])
        self.seed = seeds.to(torch.int64).expand(batch)

    def check(self) -> None:
        """Raise, as on making, for numbers that do not fit (any more)."""
        MeasurementNoise(self.std, self.seed, self.rate)

    @property
    def batch_shape(self) -> torch.Size:
        """Leading batch dimensions `...`."""
        return self.seed.shape

    def expand(self, batch_shape: Sequence[int]) -> MeasurementNoise:
        """The same noise with leading batch dimensions `batch_shape`."""
        shape = tuple(batch_shape)
        std = self.std.expand(*shape, self.std.shape[-1])
        return MeasurementNoise(std, self.seed.expand(shape), self.rate)

    def select(self, members: Sequence[int]) -> MeasurementNoise:
        """Some members of the first batch dimension."""
        chosen = list(members)
        return MeasurementNoise(self.std[chosen], self.seed[chosen], self.rate)

    @staticmethod
    def stack(noises: Sequence[MeasurementNoise]) -> MeasurementNoise:
        """One noise with a new leading batch dimension. Raises `ConfigError` for unequal rates."""
        noises = several("noises", noises, MeasurementNoise)
        if len({noise.rate for noise in noises}) != 1:
            raise ConfigError("noises to stack must have the same rate")
        return MeasurementNoise(
            torch.stack([noise.std for noise in noises]),
            torch.stack([noise.seed for noise in noises]),
            noises[0].rate,
        )

    def instants(self, starts: Tensor) -> Tensor:
        """Number of the sampling instant in force in the steps that start at `starts` (T,) [s]."""
        if self.rate is None:
            return torch.arange(len(starts))
        return torch.floor(starts * self.rate + 1e-6).to(torch.int64)

    def table(self, widths: Sequence[int], n_instants: int) -> NoiseTable:
        """The numbers behind the noise on fields of these widths, each seed's once.

        Raises `ShapeError` where there is not one standard deviation a field or a number.
        """
        seeds, row = torch.unique(self.seed, return_inverse=True)
        width = sum(widths)
        count = -(-n_instants * width // BLOCK) * BLOCK
        unit = torch.empty(len(seeds), count, dtype=torch.float64)
        for stream, seed in zip(unit, seeds.tolist(), strict=True):
            torch.randn(
                count, generator=torch.Generator().manual_seed(seed), out=stream, dtype=stream.dtype
            )
        unit = unit[:, : n_instants * width].reshape(len(seeds), n_instants, width)
        return NoiseTable(unit, row, self._per_number(widths))

    def _per_number(self, widths: Sequence[int]) -> Tensor:
        """Standard deviations (..., Y)."""
        given = self.std.shape[-1]
        if given == len(widths):
            return self.std.repeat_interleave(torch.tensor(widths), dim=-1)
        if given == sum(widths):
            return self.std
        raise ShapeError(
            f"noise std has {given} numbers: give one for each of the {len(widths)} fields of the "
            f"measurement, or for each of its {sum(widths)} numbers"
        )
