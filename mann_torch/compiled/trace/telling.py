"""What stopped a trace, and where in the user's code an operation of it comes from."""

from __future__ import annotations

import os
import re
import traceback

from torch.fx import Node

from ...errors import MannError
from ...telling import NOT_THEIRS

_FRAME = re.compile(r'\s*File "(.+)", line (\d+), in (.+)')


class UntraceableError(MannError):
    """A step that cannot be compiled; the message says which operation, where, and why."""


def source_of(node: Node) -> str:
    """Where in the user's code an operation comes from; empty if it is not known."""
    trail = node.meta.get("stack_trace") or ""
    found = [
        frame
        for frame in traceback.StackSummary.from_list(_frames(trail))
        if not frame.filename.startswith(NOT_THEIRS)
    ]
    if not found:
        return ""
    last = found[-1]
    return f", {os.path.basename(last.filename)}:{last.lineno}: {(last.line or '').strip()}"


def _frames(trail: str) -> list[tuple[str, int, str, str]]:
    frames, lines = [], trail.splitlines()
    for i, line in enumerate(lines):
        found = _FRAME.match(line)
        if found is not None:
            file, number, name = found.groups()
            code = lines[i + 1].strip() if i + 1 < len(lines) else ""
            code = "" if _FRAME.match(code) else code
            frames.append((file, int(number), name, code))
    return frames
