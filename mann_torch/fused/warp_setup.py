"""Warp, started quietly and once. The only way by which the rest of the library reaches it."""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

#: Warp may be started, and a kernel built, by one thread at a time.
LOCK = threading.RLock()


def missing() -> str | None:
    """None once Warp runs here, else why it does not."""
    with LOCK:
        return _start()


@functools.cache
def _start() -> str | None:
    try:
        with _silent_stderr():
            import warp as wp

            wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
            wp.init()
    except Exception as error:  # a missing wheel, a foreign platform, an unwritable cache
        return f"warp-lang cannot be used ({type(error).__name__}: {error})"
    return None


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Drop what native code prints: Warp warns on stderr wherever there is no CUDA driver."""
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # no stderr at all
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)
