"""What fails is one line on stderr."""

from __future__ import annotations

import os
import re
import sys
from typing import NoReturn

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from mann_torch.errors import MannError

#: Exit codes: a setting that cannot be used, a run that failed, Ctrl-C.
BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130


def speak_any_terminal() -> None:
    """A terminal that lacks a sign gets a question mark, not a traceback; a closed one, nothing."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - until the process ends
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def fail(error: BaseException, code: int) -> NoReturn:
    """One line on stderr, then exit."""
    if isinstance(error, BrokenPipeError):
        # What is left in the buffer would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    print(f"error: {one_line(error)}", file=sys.stderr)
    sys.exit(code)


def one_line(error: BaseException) -> str:
    """What it says, in one line."""
    text = str(error).strip()
    if isinstance(error, BrokenPipeError):
        return "stdout was closed before the end"
    if isinstance(error, MemoryError) or "can't allocate memory" in text:
        return "out of memory: fewer draws, a shorter horizon, or a larger sample_dt"
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror
    missing = re.search(r"Could not find '([^']+)/([^'/]+)'", text)
    if missing:
        options = re.search(
            r"Available options in '[^']+':\s*((?:\S+\s*)+?)(?:Config search|$)", text
        )
        group, name = missing.groups()
        names = ", ".join(options.group(1).split()) if options else "see --help"
        return f"unknown {group} '{name}'; choose from {names}"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    cause = error.__cause__
    first = lines[0] if lines else ""
    if not isinstance(error, MannError | HydraException | OmegaConfBaseException):
        first = f"{type(error).__name__}: {first}"
    if cause is not None and str(cause).strip():
        first = f"{first} ({str(cause).strip().splitlines()[0]})"
    return first
