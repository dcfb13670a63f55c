"""Arguments, checked where they come in: a number, a size, a flag, a name, a part.

Each check returns what it was given in one form, or raises an error that says which argument, what
was given and what is wanted. A wrong type is a `KindError`, a value out of range a `ConfigError`.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping
from numbers import Real
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import torch

from .errors import ConfigError, InterfaceError, KindError

Kind = TypeVar("Kind")


class Range(NamedTuple):
    """Numbers that an argument may be; NaN is in none."""

    text: str
    holds: Callable[[float], bool]


POSITIVE = Range("finite and > 0", lambda x: 0 < x < math.inf)
NONNEGATIVE = Range("finite and >= 0", lambda x: 0 <= x < math.inf)
#: Infinity counts: no limit.
ABOVE_0 = Range("> 0", lambda x: x > 0)
FROM_0 = Range(">= 0", lambda x: x >= 0)
WITHIN_2 = Range("> 0 and < 2", lambda x: 0 < x < 2)


def shown(value: object) -> str:
    """A value as an error says it; of what is long, the type alone."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    said = repr(value)
    return f"a {type(value).__name__}" if len(said) > 60 or "\n" in said else said


def wrong(name: str, value: object, wanted: str) -> KindError:
    """The error of an argument of a wrong type, to be raised."""
    return KindError(f"{name} = {shown(value)}: must be {wanted}")


def number(
    name: str, value: Any, within: Range | None = None, error: type[ConfigError] = ConfigError
) -> float:
    """A real number, Python's, NumPy's or a tensor's of no dimension, as a float. No bool.

    Raises `KindError`, or `error` for one that is not `within`.
    """
    given = value
    if getattr(value, "shape", None) == () and callable(getattr(value, "item", None)):
        try:
            value = value.item()
        except RuntimeError:  # a tensor without a value: torch.func, the meta device
            raise wrong(name, given, "a number") from None
    if isinstance(value, bool) or not isinstance(value, Real):
        raise wrong(name, given, "a number")
    try:
        found = float(value)
    except OverflowError:
        raise error(f"{name} = {shown(given)}: is too large") from None
    if within is not None and not within.holds(found):
        raise error(f"{name} = {found}: must be {within.text}")
    return found


def maybe(name: str, value: Any, within: Range | None = None) -> float | None:
    """`number`, or None."""
    return None if value is None else number(name, value, within)


def is_whole(value: Any) -> bool:
    """Whether it is a whole number, Python's, NumPy's or a tensor's; no bool."""
    if isinstance(value, int | torch.SymInt):
        return not isinstance(value, bool)
    if "bool" in str(getattr(value, "dtype", "")):
        return False
    try:
        operator.index(value)
    except TypeError:
        return False
    return True


def whole(name: str, size: Any, least: int | None = 1) -> int:
    """A whole number of at least `least` as an int. Raises `KindError` or `ConfigError`."""
    if not is_whole(size):
        raise wrong(name, size, "a whole number")
    count = operator.index(size)
    if least is not None and count < least:
        raise ConfigError(f"{name} = {count}: must be at least {least}")
    return count


def elements(value: Any) -> list[Any] | None:
    """What a sequence holds; None of what is no sequence: a string, a mapping, a lone tensor."""
    if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping):
        return None
    try:
        return list(value)
    except TypeError:  # a tensor of no dimension
        return None


def sizes(name: str, shape: Any, single: bool = True, signed: bool = False) -> tuple[int, ...]:
    """Whole numbers, >= 0 if not `signed`, or with `single` one alone, as a tuple.

    Raises `KindError`.
    """
    wanted = "whole numbers" if signed else "whole numbers >= 0"
    found = elements(shape)
    if found is None:
        if not (single and is_whole(shape)):
            raise wrong(name, shape, f"a sequence of {wanted}" + ", or one" * single)
        found = [shape]
    if any(not is_whole(size) or (size < 0 and not signed) for size in found):
        raise wrong(name, shape, wanted)
    symbol: Any = torch.SymInt  # of torch.export, which stands for an int
    return tuple(x if isinstance(x, symbol) else operator.index(x) for x in found)


def flag(name: str, value: Any) -> bool:
    """True or False. Raises `KindError`."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise wrong(name, value, "True or False")


def text(name: str, value: Any) -> str:
    """A string. Raises `KindError`."""
    return instance(name, value, str, "a string")


def choice(name: str, value: Any, known: Iterable[str]) -> str:
    """One of the names `known`. Raises `KindError`, or `ConfigError` for another name."""
    listed = ", ".join(known)
    if not isinstance(value, str):
        raise KindError(f"{name} = {shown(value)}: choose from {listed}")
    if value not in listed.split(", "):
        raise ConfigError(f"{name} = {value!r}: choose from {listed}")
    return value


def instance(name: str, value: Any, kind: Callable[..., Kind], wanted: str = "") -> Kind:
    """`value`, if it is an instance of the class `kind`, abstract or not. Raises `KindError`.

    `InterfaceError` for a module that was never set up.
    """
    cls = cast(type[Kind], kind)
    if not isinstance(value, cls):
        if cls is torch.Tensor and isinstance(value, np.ndarray):
            wanted = wanted or "a Tensor, as torch.as_tensor makes one of an array"
        article = "an" if cls.__name__[0] in "AEIOU" else "a"
        raise wrong(name, value, wanted or f"{article} {cls.__name__}")
    if isinstance(value, torch.nn.Module) and "_modules" not in vars(value):
        raise InterfaceError(f"{type(value).__name__}.__init__ does not call super().__init__()")
    return value


def function(name: str, value: Any) -> None:
    """Raise `KindError` for what can't be called."""
    if not callable(value):
        raise wrong(name, value, "a function")


def several(name: str, value: Any, kind: Callable[..., Kind], wanted: str = "") -> list[Kind]:
    """Instances of `kind` in a row, of which a string is none, as a list. Raises `KindError`."""
    rows = elements(value)
    if rows is None:
        raise wrong(name, value, f"a sequence of {wanted or kind.__name__}")
    return [instance(f"{name}[{i}]", each, kind, wanted) for i, each in enumerate(rows)]


def named(name: str, value: Any, kind: Callable[..., Kind], wanted: str = "") -> dict[str, Kind]:
    """A mapping from names to instances of `kind`, as a dict. Raises `KindError`."""
    if not isinstance(value, Mapping):
        raise wrong(name, value, f"a mapping from names to {wanted or kind.__name__}")
    return {
        text(f"a name in {name}", key): instance(f"{name}[{key!r}]", each, kind, wanted)
        for key, each in value.items()
    }
