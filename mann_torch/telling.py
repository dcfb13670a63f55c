"""What failed in a part of somebody's own, and the line of it."""

from __future__ import annotations

import linecache
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch
from torch import Tensor

from .errors import MannError

_HERE = os.path.dirname(__file__) + os.sep
#: Where nobody's mistake is looked for: torch, the compiler, what checks parts.
NOT_THEIRS = (
    os.path.dirname(torch.__file__),
    *(_HERE + room + os.sep for room in ("compiled", "testing")),
)
#: How torch says, in its various ways of running code, that Python asked for a tensor's value.
_DECIDES = (
    "data-dependent",
    "unallocated storage",
    "Boolean value of Tensor with more than one value is ambiguous",
    ".item() on a Tensor",
    "cannot be converted to Scalar",
)


def explained(error: Exception) -> str:
    """In one line: what was wrong, and the line of the user's code (or ours) that it came from."""
    text = " ".join(str(error).split())
    if any(words in text for words in _DECIDES) or "GuardOnData" in type(error).__name__:
        what = "a decision on data (`if tensor`, `bool(tensor)`, `.item()`: take torch.where)"
    elif "convert all Tensors to FakeTensors" in text:
        what = "a tensor that is neither parameter nor buffer"
    elif isinstance(error, MannError):
        what = text
    else:
        what = f"{type(error).__name__}: {text[:160]}"
    return what + place_of(error)


def place_of(error: BaseException) -> str:
    """` in Part, file.py:12: the line`, as far as it is known.

    Of an error that this library raises on purpose it is the line that called us.
    """
    ours = isinstance(error, MannError)
    place, module, met, tb = None, None, not ours, error.__traceback__
    while tb is not None:
        name = tb.tb_frame.f_code.co_filename
        if name.startswith(_HERE):
            met = True  # what is above it is whoever called for all of this
        if met and not name.startswith((*NOT_THEIRS, "<", *([_HERE] if ours else []))):
            place = (name, tb.tb_lineno)
            owner = tb.tb_frame.f_locals.get("self")
            module = type(owner).__name__ if isinstance(owner, torch.nn.Module) else module
        tb = tb.tb_next
    if place is None:
        return ""
    line = linecache.getline(*place).strip()
    inside = f" in {module}" if module else ""
    return f"{inside}, {os.path.basename(place[0])}:{place[1]}" + (f": {line}" if line else "")


def misread(value: Tensor) -> str:
    """A number of a float32 tensor that was meant otherwise, as float64 shows it; empty: none.

    `torch.tensor(0.1)` is 0.10000000149011612, in eager torch too; 0.5 is 0.5.
    """
    numbers = value.detach().reshape(-1)
    for x in numbers[numbers.isfinite()].tolist():
        said = str(np.float32(x))
        if float(said) != x:
            return f"{said} is {x!r}"
    return ""


@contextmanager
def quiet(logger: str, below: int) -> Iterator[None]:
    """Without what another library would say here of less than a level."""
    log = logging.getLogger(logger)
    level = log.level
    log.setLevel(below)
    try:
        yield
    finally:
        log.setLevel(level)
