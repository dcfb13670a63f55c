"""Many rollouts as columns, on disk as CSV with all digits."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mann_torch.errors import ConfigError

from ..runs.writing import csv_text

ROLLOUTS = "rollouts.csv"
_COUNTS = ("reallocations", "switches")


@dataclass(frozen=True)
class Rollouts:
    """An entry a rollout; SRMSE is NaN where it diverged."""

    outputs: np.ndarray  # (p, 2) text: their names and units
    entries: np.ndarray  # (d,) text: entries of the plant's parameters that are a rollout's own
    number: np.ndarray  # (N,) int
    drawn: np.ndarray  # (N, d), at t = 0
    srmse: np.ndarray  # (N, p), in the outputs' units
    srmse_after_10s: np.ndarray  # (N, p)
    reallocations: np.ndarray  # (N,) int
    switches: np.ndarray  # (N,) int
    status: np.ndarray  # (N,) text

    def __len__(self) -> int:
        return len(self.number)

    @property
    def ok(self) -> np.ndarray:
        """Which came to their end, (N,) bool."""
        return self.status == "ok"

    @property
    def names(self) -> list[str]:
        """Of the outputs."""
        return [str(name) for name in self.outputs[:, 0]]

    def errors(self) -> dict[str, np.ndarray]:
        """SRMSE by column name, an output after the other, then those after 10 s."""
        return {
            f"{key}_{name}": column
            for key in ("srmse", "srmse_after_10s")
            for name, column in zip(self.names, getattr(self, key).T, strict=True)
        }


@dataclass(frozen=True)
class Chunk(Rollouts):
    """Rollouts computed at once: by what engine, and how large the process has been [MB]."""

    engine: str
    peak_mb: float


def drawn_of(parameters: Mapping[str, np.ndarray], count: int) -> dict[str, np.ndarray]:
    """`drawn` and `entries` of `count` rows (N, d) of the plant's parameters by name."""
    entries = [f"{n}_{i + 1}" for n, rows in parameters.items() for i in range(rows.shape[1])]
    drawn = np.concatenate([np.empty((count, 0)), *parameters.values()], axis=1)
    return {"drawn": drawn, "entries": np.array(entries, str)}


def joined(parts: Sequence[Rollouts]) -> Rollouts:
    """All of them by number; a number that comes twice is the same rollout."""
    shared = {"outputs": parts[0].outputs, "entries": parts[0].entries}
    columns = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in dataclasses.fields(Rollouts)
        if field.name not in shared
    }
    _, rows = np.unique(columns["number"], return_index=True)
    return Rollouts(**shared, **{name: column[rows] for name, column in columns.items()})


def columns_of(rollouts: Rollouts) -> dict[str, list[Any]]:
    """An entry a rollout; empty where there is no value."""
    entries = [str(entry) for entry in rollouts.entries]
    numbers = dict(zip(entries, rollouts.drawn.T, strict=True)) | rollouts.errors()
    found: dict[str, list[Any]] = {"rollout": rollouts.number.tolist()}
    for name, column in numbers.items():
        found[name] = ["" if value != value else value for value in column.tolist()]
    return found | {name: getattr(rollouts, name).tolist() for name in (*_COUNTS, "status")}


def text_of(ensembles: Mapping[str, Rollouts]) -> str:
    """As CSV; of several, with a first column that says of which, and all columns of any."""
    tables = {name: columns_of(rollouts) for name, rollouts in ensembles.items()}
    header = list(dict.fromkeys(key for table in tables.values() for key in table))
    rows: list[Sequence[object]] = []
    for name, table in tables.items():
        empty = [""] * len(table["rollout"])
        body = zip(*(table.get(key, empty) for key in header), strict=True)
        rows += body if len(tables) == 1 else ((name, *row) for row in body)
    return csv_text([header if len(tables) == 1 else ["ensemble", *header], *rows])


def read_rollouts(folder: Path, outputs: Sequence[tuple[str, str]]) -> Rollouts:
    """Those of a finished ensemble of such outputs, names and units. Raises `ConfigError`."""
    path, p = folder / ROLLOUTS, len(outputs)
    try:
        header, *rows = csv.reader(io.StringIO(path.read_text()))
        columns = dict(zip(header, map(np.array, zip(*rows, strict=True)), strict=True))
        entries = header[1 : len(header) - 2 * p - len(_COUNTS) - 1]
        numbers = header[1 : len(header) - len(_COUNTS) - 1]
        of = {n: np.where(columns[n] == "", "nan", columns[n]).astype(float) for n in numbers}
        place = len(entries)
        wide = np.stack([*of.values()], axis=1)
        found = Rollouts(
            outputs=np.array(outputs, str).reshape(p, 2),
            entries=np.array(entries, str),
            number=columns["rollout"].astype(int),
            drawn=wide[:, :place],
            srmse=wide[:, place : place + p],
            srmse_after_10s=wide[:, place + p :],
            reallocations=columns["reallocations"].astype(int),
            switches=columns["switches"].astype(int),
            status=columns["status"],
        )
        if list(columns_of(found)) != header:
            raise ValueError("other columns")
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"{path}: no rollouts can be read: {error}") from None
    return found
