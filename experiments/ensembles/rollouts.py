"""Many rollouts as columns, on disk as CSV with all digits."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mann_torch.errors import ConfigError

from ..runs.writing import csv_text

ROLLOUTS = "rollouts.csv"
HEADER = (
    *("rollout", "mass_1", "mass_2", "srmse_1", "srmse_2", "srmse_after_10s_1"),
    *("srmse_after_10s_2", "reallocations", "switches", "status"),
)


@dataclass(frozen=True)
class Rollouts:
    """An entry a rollout; SRMSE is NaN where it diverged."""

    number: np.ndarray  # (N,) int
    masses: np.ndarray  # (N, 2) [kg], at t = 0
    srmse: np.ndarray  # (N, 2) [rad]
    srmse_after_10s: np.ndarray  # (N, 2) [rad]
    reallocations: np.ndarray  # (N,) int
    switches: np.ndarray  # (N,) int
    status: np.ndarray  # (N,) text

    def __len__(self) -> int:
        return len(self.number)

    @property
    def ok(self) -> np.ndarray:
        """Which came to their end, (N,) bool."""
        return self.status == "ok"


@dataclass(frozen=True)
class Chunk(Rollouts):
    """Rollouts computed at once: by what engine, and how large the process has been [MB]."""

    engine: str
    peak_mb: float


def joined(parts: Sequence[Rollouts]) -> Rollouts:
    """All of them by number; a number that comes twice is the same rollout."""
    columns = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in dataclasses.fields(Rollouts)
    }
    _, rows = np.unique(columns["number"], return_index=True)
    return Rollouts(**{name: column[rows] for name, column in columns.items()})


def rows_of(rollouts: Rollouts) -> list[list[object]]:
    """A row a rollout; empty where there is no value."""
    measured = (rollouts.masses, rollouts.srmse, rollouts.srmse_after_10s)
    counted = (rollouts.reallocations, rollouts.switches, rollouts.status)
    columns: list[list[object]] = [rollouts.number.tolist()]
    columns += [
        ["" if value != value else value for value in column.tolist()]
        for table in measured
        for column in table.T
    ]
    columns += [column.tolist() for column in counted]
    return [list(row) for row in zip(*columns, strict=True)]


def text_of(rollouts: Rollouts) -> str:
    """As CSV."""
    return csv_text([HEADER, *rows_of(rollouts)])


def read_rollouts(folder: Path) -> Rollouts:
    """Those of a finished ensemble. Raises `ConfigError`."""
    path = folder / ROLLOUTS
    try:
        header, *rows = csv.reader(io.StringIO(path.read_text()))
        if tuple(header) != HEADER:
            raise ValueError("other columns")
        number, *measured, reallocations, switches, status = (
            np.array(column) for column in zip(*rows, strict=True)
        )
        values = [np.where(column == "", "nan", column).astype(float) for column in measured]
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: no rollouts can be read: {error}") from None
    masses, srmse, late = (np.stack(values[place : place + 2], axis=1) for place in (0, 2, 4))
    counts = [column.astype(int) for column in (number, reallocations, switches)]
    return Rollouts(counts[0], masses, srmse, late, counts[1], counts[2], status)
