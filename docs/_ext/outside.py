"""Links of a page that leave docs/: to the page that shows the file, or no link."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

#: Files of the repository that the site shows.
SHOWN = {
    "README.md": "index.md",
    "BENCHMARKS.md": "speed.md",
    "ARCHITECTURE.md": "architecture.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
_LINK = re.compile(
    r"(?<!!)\[(?P<text>[^\]]+)\]\((?P<up>(?:\.\./)+)(?P<file>[^)#\s]+)(?P<at>#[^)]+)?\)"
)


def inside(text: str, page: Path, docs: Path) -> str:
    """A page with its links to files of the repository turned."""

    def turned(link: re.Match[str]) -> str:
        target = (page.parent / link["up"] / link["file"]).resolve()
        if target.is_relative_to(docs):
            return link[0]
        name = target.relative_to(docs.parent).as_posix() if target.exists() else ""
        if name in SHOWN and (docs / SHOWN[name]).exists():
            back = "../" * len(page.relative_to(docs).parts[:-1])
            return f"[{link['text']}]({back}{SHOWN[name]}{link['at'] or ''})"
        return link["text"] if target.exists() else link[0]

    return _LINK.sub(turned, text)


def _read(app: Sphinx, name: str, source: list[str]) -> None:
    docs = Path(app.srcdir).resolve()
    page = Path(app.env.doc2path(name)).resolve()
    if page.suffix == ".md":
        source[0] = inside(source[0], page, docs)


def setup(app: Sphinx) -> dict[str, bool]:
    """Before a page is parsed."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
