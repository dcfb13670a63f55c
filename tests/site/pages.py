"""Pages of the site and of the repository, and the blocks of code on them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: What the build writes, and what is no page.
MADE = ("_build", "_ext", "api", "auto_gallery", "gallery", "jupyter_execute", "inventories")
#: Pages of the repository that the site shows too, or that readers meet first.
OUTSIDE = ("README.md", "ARCHITECTURE.md", "BENCHMARKS.md", "CONTRIBUTING.md")
_FENCE = re.compile(
    r"^(?P<fence>`{3,})(?P<language>[^\n`]*)\n(?P<body>.*?)^(?P=fence)$", re.S | re.M
)


class Block(NamedTuple):
    """A fenced block of a page."""

    page: str  # "memory.md", "write/plant.md"; of the repository "README.md"
    line: int
    language: str
    body: str


def pages() -> dict[str, Path]:
    """Every page that is written by hand, by its name."""
    own = [p for p in DOCS.rglob("*.md") if p.relative_to(DOCS).parts[0] not in MADE]
    found = {p.relative_to(DOCS).as_posix(): p for p in sorted(own)}
    return found | {name: ROOT / name for name in OUTSIDE if (ROOT / name).exists()}


def blocks_of(name: str, path: Path) -> Iterator[Block]:
    """The fenced blocks of a page."""
    text = path.read_text()
    for found in _FENCE.finditer(text):
        line = text[: found.start()].count("\n") + 1
        yield Block(name, line, found["language"].strip(), found["body"])


def blocks() -> list[Block]:
    """The fenced blocks of all pages."""
    return [block for name, path in pages().items() for block in blocks_of(name, path)]


def commands(block: Block) -> list[list[str]]:
    """The words of each command of a shell block, without comments; lines may be continued."""
    joined = block.body.replace("\\\n", " ")
    rows = (shlex.split(row, comments=True) for row in joined.splitlines())
    return [words for words in rows if words]


def shell_lines() -> dict[str, list[str]]:
    """Each command that a page shows, once, by its text."""
    shown = [words for b in blocks() if b.language == "sh" for words in commands(b)]
    return {shlex.join(words): words for words in shown}
