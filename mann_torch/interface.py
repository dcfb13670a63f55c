"""What the interfaces of the library have in common: a forgotten method names itself."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import Any, ClassVar, Self

from .errors import InterfaceError


class Interface(ABC):
    """A class that cannot be made before it has all its abstract methods.

    Raises `InterfaceError`, which names the class, what it lacks, and what each of them is for.
    """

    __abstractmethods__: ClassVar[frozenset[str]]
    #: Attributes that a class must give, and what each is.
    required: ClassVar[Mapping[str, str]] = {}

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        without = [name for name in cls.required if not hasattr(cls, name)]
        missing = sorted([*cls.__abstractmethods__, *without])
        if missing:
            told = "; ".join(f"{name}: {_purpose(cls, name)}" for name in missing)
            raise InterfaceError(f"{cls.__name__} lacks {', '.join(missing)} ({told})")
        return super().__new__(cls)


def _purpose(cls: type[Interface], name: str) -> str:
    """First line of what is said of what is missing."""
    text: str = cls.required.get(name) or getattr(cls, name).__doc__ or "no description"
    return text.strip().splitlines()[0].rstrip(".")
