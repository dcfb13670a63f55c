"""The arithmetic of a program: float64 with 64-bit integers, or float32 with 32-bit ones."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from .trace.telling import UntraceableError


class Real(NamedTuple):
    """Floating numbers and the integers of their width, by their names in C++."""

    name: str
    whole: str
    bytes: int
    dtype: torch.dtype
    whole_dtype: torch.dtype
    suffix: str  # of a literal

    def rounded(self, value: float) -> float:
        """A number as this arithmetic holds it."""
        if self.bytes == 8:
            return float(value)
        with np.errstate(over="ignore"):
            return float(np.float32(value))

    def wrapped(self, value: int) -> int:
        """An integer as its bits hold it."""
        half = 2 ** (8 * self.bytes - 1)
        return (value + half) % (2 * half) - half

    def holds(self, value: int) -> bool:
        """Whether an integer has bits enough."""
        return self.wrapped(value) == value


DOUBLE = Real("double", "long long", 8, torch.float64, torch.int64, "")
FLOAT = Real("float", "int", 4, torch.float32, torch.int32, "f")
REALS = {real.dtype: real for real in (DOUBLE, FLOAT)}


def real_of(examples: Iterable[Tensor]) -> Real:
    """The arithmetic of floating examples, float64 where there is none.

    Raises `UntraceableError` where they are of several dtypes, or of another one.
    """
    found = {x.dtype for x in examples if x.is_floating_point()}
    names = " and ".join(sorted(str(dtype).removeprefix("torch.") for dtype in found))
    if len(found) > 1:
        raise UntraceableError(f"a step of {names} together: lanes compute in one of them")
    for dtype in found:
        if dtype not in REALS:
            raise UntraceableError(f"numbers of {dtype}: lanes compute in float64 or float32")
        return REALS[dtype]
    return DOUBLE
