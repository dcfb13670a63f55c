"""A command line of `experiments`, in this process."""

import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


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


def logged(folder: Path) -> EventAccumulator:
    """What the run in a folder has told TensorBoard, as one run named by what was asked for."""
    (place,) = {path.parent for path in folder.rglob("events.out.tfevents.*")}
    assert place.parent == folder and "=" in place.name
    return EventAccumulator(str(place), size_guidance={"scalars": 0, "images": 0}).Reload()
