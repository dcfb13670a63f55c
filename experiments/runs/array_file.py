"""Arrays of an .npz file from elsewhere, read by rows: what unfolds to gigabytes never does."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

#: What a file that is no .npz, or a broken one, makes Python raise.
READ_ERRORS = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    AttributeError,
    TypeError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)
_BLOCK = 1 << 20  # bytes


class ArrayFile:
    """Names, shapes and rows of an .npz file; only headers are read when it is opened.

    Raises any of `READ_ERRORS`.
    """

    def __init__(self, path: Path) -> None:
        self._zip = zipfile.ZipFile(path)
        self._headers: dict[str, tuple[tuple[int, ...], bool, np.dtype[Any]]] = {}
        for info in self._zip.infolist():
            if info.filename.endswith(".npy"):
                with self._zip.open(info) as file:
                    self._headers[info.filename.removesuffix(".npy")] = _header(file)
        if not self._headers:
            raise ValueError("no arrays in it")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """By name."""
        return {name: shape for name, (shape, _, _) in self._headers.items()}

    def kind(self, name: str) -> str:
        """Of the numbers: i, u, f ... as in `numpy.dtype.kind`."""
        return self._headers[name][2].kind

    def rows(
        self, name: str, rows: Sequence[int], dtype: type[Any] = np.float64
    ) -> np.ndarray[Any, Any]:
        """Some of the first axis, in that order, as numbers of a type."""
        shape, fortran, stored = self._headers[name]
        if fortran and len(shape) > 1:
            raise ValueError(f"'{name}' is stored by columns: save np.ascontiguousarray of it")
        if stored.kind not in "iuf":
            raise ValueError(f"'{name}' holds {stored}, not numbers")
        size = int(np.prod(shape[1:], dtype=object)) * stored.itemsize
        wanted = {row: place for place, row in enumerate(rows)}
        found = np.empty((len(rows), *shape[1:]), dtype)
        with self._zip.open(f"{name}.npy") as file:
            _header(file)
            at = 0
            for row in sorted(wanted):
                _skip(file, (row - at) * size)
                content = file.read(size)
                if len(content) < size:
                    raise EOFError(f"'{name}' ends early")
                found[wanted[row]] = np.frombuffer(content, stored).reshape(shape[1:])
                at = row + 1
            while file.read(_BLOCK):  # to its end: only there is its checksum compared
                pass
        return found

    def __enter__(self) -> ArrayFile:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._zip.close()


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = npy.read_magic(file)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(file)
    if dtype.hasobject:
        raise ValueError("it holds Python objects, not numbers")
    return shape, fortran, dtype


def _skip(file: IO[bytes], count: int) -> None:
    while count > 0:
        taken = len(file.read(min(count, _BLOCK)))
        if not taken:
            raise EOFError("it ends early")
        count -= taken
