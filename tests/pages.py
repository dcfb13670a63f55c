"""Pages of the documentation whose code is run."""

from __future__ import annotations

import contextlib
import io
import re
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import torch

DOCS = Path(__file__).parent.parent / "docs"
#: Fenced blocks: their language, and what they hold.
BLOCK = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.S | re.M)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
#: How far a number that a page shows may be from the one that is printed, of itself.
SHOWN = 1e-3


class Snippet(NamedTuple):
    """A piece of a page's Python, and what the page shows of what it prints."""

    code: str
    shown: str | None  # the ```text block right below it


def text_of(name: str) -> str:
    """A page."""
    return (DOCS / name).read_text()


def pieces_of(name: str) -> list[Snippet]:
    """A page's Python, blocks and cells, each with the output that is shown below it."""
    found: list[Snippet] = []
    end = -1
    page = text_of(name)
    for block in BLOCK.finditer(page):
        language, body = block.groups()
        if language == "python" or language.startswith("{code-cell}"):
            found.append(Snippet(re.sub(r"\A(?::.*\n)+", "", body), None))
            end = block.end()
        elif language == "text" and not page[end : block.start()].strip() and end > 0:
            found[-1] = found[-1]._replace(shown=body)
    return found


def snippets_of(name: str) -> list[str]:
    """A page's Python."""
    return [piece.code for piece in pieces_of(name)]


def part_of(name: str, what: str) -> str:
    """The one piece of a page's Python that has these words."""
    (found,) = (snippet for snippet in snippets_of(name) if what in snippet)
    return found


@cache
def executed(name: str) -> dict[str, Any]:
    """All that a page's snippets define, run in their order, and what they print, `printed`.

    What a page shows of that is held against it: the same words, the same numbers to `SHOWN`. Run
    once a process: nobody is to write to what it gives.
    """
    names: dict[str, Any] = {}
    torch.manual_seed(0)
    printed = ""
    for code, shown in pieces_of(name):
        written = io.StringIO()
        with contextlib.redirect_stdout(written):
            exec(compile(code, f"docs/{name}", "exec"), names)
        printed += written.getvalue()
        if shown is not None:
            told = difference(written.getvalue(), shown)
            assert told is None, f"docs/{name} shows what is not printed: {told}"
    return {**names, "printed": printed}


def difference(printed: str, shown: str) -> str | None:
    """Where the two differ, None where they do not.

    >>> difference("a 1.00001", "a 1.0") is None, difference("a 1.1", "a 1.0")
    (True, "'1.1', not '1.0'")
    """
    if NUMBER.sub("#", printed).split() != NUMBER.sub("#", shown).split():
        return f"{printed!r}, not {shown!r}"
    for one, other in zip(NUMBER.findall(printed), NUMBER.findall(shown), strict=True):
        a, b = float(one), float(other)
        if abs(a - b) > SHOWN * abs(b):
            return f"{one!r}, not {other!r}"
    return None
