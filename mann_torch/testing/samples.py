"""Samples of a reference with just as many derivatives as a part says that it reads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

from ..telling import explained
from ..types import ReferenceSample
from .functions import SAMPLES
from .telling import broken


def drawn_sample(width: int, order: int, generator: torch.Generator) -> ReferenceSample:
    """A random value and `order` derivatives, each (SAMPLES, p)."""
    shape = (order + 1, SAMPLES, width)
    return ReferenceSample(*torch.randn(*shape, generator=generator, dtype=torch.float64))


def check_order(
    part: object,
    line: int | str,
    what: str,
    name: str,
    sample: ReferenceSample,
    ask: Callable[[ReferenceSample], Any],
) -> None:
    """Raise `InterfaceError` where `ask` fails on a sample, but not on one with all derivatives.

    `name` is the attribute that says how many are read.
    """
    try:
        ask(sample)
    except Exception as error:
        full = ReferenceSample(*(x if x is not None else sample.value for x in sample.parts))
        full = full._replace(command=sample.command)
        try:
            ask(full)
        except Exception:
            return  # something else is wrong, which others tell
        raise broken(
            part,
            line,
            f"{what} reads more than the {getattr(part, name)} derivatives that {name} says",
            f"set `{name}`, and read by `upto`; {explained(error)}",
        ) from error
