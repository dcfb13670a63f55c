"""A command line of `experiments`, in this process."""

import sys
from collections.abc import Callable

import pytest


def exit_code(monkeypatch: pytest.MonkeyPatch, main: Callable[[], None], *arguments: str) -> int:
    """What the command line would return to the shell."""
    monkeypatch.setattr(sys, "argv", [main.__module__.rsplit(".", 1)[-1], *arguments])
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0
