"""How a broken contract is told."""

from __future__ import annotations

from ..errors import InterfaceError


def broken(part: object, line: int | str, found: str, mend: str) -> InterfaceError:
    """The error of a part that breaks a line of its contract, to be raised."""
    return InterfaceError(f"{type(part).__name__}, contract line {line}: {found}; {mend}")
