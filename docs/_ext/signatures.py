"""Signatures of the reference, and which inherited members a class shows."""

from __future__ import annotations

import re
from collections.abc import Container
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.inspect import safe_getattr

from mann_torch.interface import Interface

#: `Numbers`, as Python spells it out.
_NUMBERS = re.compile(
    r"float \| (~?)collections\.abc\.Sequence\[float\] \| \1collections\.abc\.Sequence\["
    r"\1collections\.abc\.Sequence\[float\]\] \| \1torch\.Tensor"
)


def shown_attribute(thing: type, name: str, *default: Any) -> Any:
    """What autodoc sees: `Interface.__new__` hands on what `__init__` is given, and hides it."""
    if name == "__new__" and safe_getattr(thing, name, None) is Interface.__new__:
        return None
    return safe_getattr(thing, name, *default)


def process_signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, given: str | None, back: str | None
) -> tuple[str | None, str | None]:
    """The alias for what it stands for, and defaults that a factory makes as an ellipsis."""
    shown = (given or "").replace("<factory>", "...") or None
    if what == "class" and not issubclass(thing, tuple):
        own = str(getattr(thing.__init__, "__module__", "")).startswith("mann_torch")
        shown = shown if own else shown and ""  # of nothing, or a protocol, which nobody makes
    return tuple(  # type: ignore[return-value]
        text and _NUMBERS.sub("~mann_torch.functional.Numbers", text) for text in (shown, back)
    )


def inherited_from(thing: type, homes: Container[int]) -> str:
    """For `:inherited-members:`, the bases whose members a class does not show as its own.

    They have a place of their own, or are not the library's; empty where all of them are so, and
    for a class that nobody derives from.
    """
    hidden = [
        base
        for base in thing.__bases__
        if base.__module__.startswith("mann_torch.")
        and id(base) not in homes
        and base is not Interface
    ]
    if not (hidden and thing.__subclasses__()):
        return ""
    return ", ".join(base.__name__ for base in thing.__mro__[1:] if base not in hidden)
