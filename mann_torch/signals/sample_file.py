"""Samples of a signal from a .csv or .npz file."""

from __future__ import annotations

import csv
import zipfile
import zlib
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..checks import wrong
from ..errors import ReferenceFileError

#: What a file that is none of its kind, or a broken one, makes Python raise.
_READ_ERRORS = (
    *(OSError, ValueError, EOFError, KeyError, MemoryError, NotImplementedError, RuntimeError),
    *(csv.Error, zipfile.BadZipFile, zlib.error),
)

_Columns = dict[str, "np.ndarray[tuple[int, ...], np.dtype[np.float64]]"]


def read_samples(path: str | Path) -> tuple[Tensor, Tensor]:
    """Times (K,) [s], of column t, and values (K, p), of the others in the file's order.

    Raises `ReferenceFileError` for a file that is missing, unreadable, without times or outputs, or
    with times that do not increase, numbers that are not finite or less than 2 rows.
    """
    if not isinstance(path, str | Path):
        raise wrong("path", path, "a path")
    file = Path(path)
    if not file.is_file():
        raise ReferenceFileError(f"reference file '{path}' does not exist")
    readers = {".csv": _of_csv, ".npz": _of_npz}
    if file.suffix.lower() not in readers:
        raise ReferenceFileError(f"reference file '{path}': give a .csv or .npz file")
    try:
        columns = readers[file.suffix.lower()](file)
    except _READ_ERRORS as error:
        cause = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ReferenceFileError(f"reference file '{path}' cannot be read: {cause}") from None
    fault = _fault(columns)
    if fault:
        raise ReferenceFileError(f"reference file '{path}': {fault}")
    times = columns.pop("t")
    return torch.from_numpy(times), torch.from_numpy(np.stack(list(columns.values()), axis=-1))


def _fault(columns: _Columns) -> str:
    """What is wrong with columns, or nothing."""
    if "t" not in columns or len(columns) < 2:
        return f"needs a column t and one per output, has {', '.join(columns) or 'none'}"
    for name, column in columns.items():
        if column.shape != columns["t"].shape or column.ndim != 1:
            return f"column {name} has shape {column.shape}, t has {columns['t'].shape}"
        if not np.isfinite(column).all():
            return f"column {name}: row {int(np.argmin(np.isfinite(column))) + 1} is not finite"
    steps = np.diff(columns["t"])
    if len(columns["t"]) < 2:
        return f"{len(columns['t'])} rows: at least 2 are needed"
    if (steps <= 0).any():
        return f"times must increase: row {int(np.argmax(steps <= 0)) + 2} does not"
    return ""


def _of_csv(path: Path) -> _Columns:
    with path.open(newline="", encoding="utf-8-sig") as file:
        heading, *lines = [[cell.strip() for cell in row] for row in csv.reader(file) if row] or [
            []
        ]
    if len(set(heading)) != len(heading):
        raise ValueError(f"two columns of one name in {', '.join(heading)}")
    for number, line in enumerate(lines, start=1):
        if len(line) != len(heading):
            raise ValueError(f"row {number} has {len(line)} numbers, the heading {len(heading)}")
    numbers = np.array([[float(cell) for cell in line] for line in lines], dtype=np.float64)
    numbers = numbers.reshape(len(lines), len(heading))
    return {name: numbers[:, j].copy() for j, name in enumerate(heading)}


def _of_npz(path: Path) -> _Columns:
    loaded = np.load(path, allow_pickle=False)
    if not isinstance(loaded, np.lib.npyio.NpzFile):
        raise ValueError("no .npz file")
    with loaded as file:
        found = {name: file[name] for name in file.files}
    for name, column in found.items():
        if column.dtype.kind not in "iuf":
            raise ValueError(f"column {name} is of type {column.dtype}, not of numbers")
    return {name: column.astype(np.float64) for name, column in found.items()}
