"""What stopped a trace, told with the line of the user's code that it came from."""

from __future__ import annotations

import linecache
import os
import re
import traceback

import torch
from torch.fx import Node

from ...errors import MannError

_TORCH = os.path.dirname(torch.__file__)
#: The compiler's own files are nobody's mistake.
_HERE = os.path.dirname(os.path.dirname(__file__))
_FRAME = re.compile(r'\s*File "(.+)", line (\d+), in (.+)')


class UntraceableError(MannError):
    """A step that cannot be compiled; the message says which operation, where, and why."""


def explained(error: Exception) -> str:
    """What stopped a trace, and the line of the user's code (or ours) it came from."""
    text = " ".join(str(error).split())
    if (
        "data-dependent" in text
        or "unallocated storage" in text
        or "GuardOnDataDependent" in type(error).__name__
    ):
        what = "a decision on data (`if tensor`, `bool(tensor)`, `.item()`)"
    elif "convert all Tensors to FakeTensors" in text:
        what = "a tensor that is neither parameter nor buffer"
    elif isinstance(error, MannError):
        what = text
    else:
        what = f"{type(error).__name__}: {text[:160]}"
    return what + _where(error)


def _where(error: BaseException) -> str:
    place, module, tb = None, None, error.__traceback__
    while tb is not None:
        name = tb.tb_frame.f_code.co_filename
        if not name.startswith((_TORCH, _HERE)) and not name.startswith("<"):
            place = (name, tb.tb_lineno)
            owner = tb.tb_frame.f_locals.get("self")
            module = type(owner).__name__ if isinstance(owner, torch.nn.Module) else module
        tb = tb.tb_next
    if place is None:
        return ""
    line = linecache.getline(*place).strip()
    inside = f" in {module}" if module else ""
    return f"{inside}, {os.path.basename(place[0])}:{place[1]}: {line}"


def source_of(node: Node) -> str:
    """Where in the user's code an operation comes from; empty if it is not known."""
    trail = node.meta.get("stack_trace") or ""
    found = [
        frame
        for frame in traceback.StackSummary.from_list(_frames(trail))
        if not frame.filename.startswith((_TORCH, _HERE))
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
