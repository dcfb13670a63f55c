"""A command line of `experiments`, in this process."""

import signal
import sys
from collections.abc import Callable

import pytest


def exit_code(monkeypatch: pytest.MonkeyPatch, main: Callable[[], None], *arguments: str) -> int:
    """What the command line would return to the shell."""
    handler = signal.getsignal(signal.SIGINT)  # a command that is interrupted ignores the next one
    monkeypatch.setattr(sys, "argv", [main.__module__.rsplit(".", 1)[-1], *arguments])
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        signal.signal(signal.SIGINT, handler)
    return 0
