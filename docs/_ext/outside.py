"""Files of the repository as pages, and links that leave docs/: to such a page, or no link."""

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
#: What a page holds that shows such a file.
_WHOLE = re.compile(r"\s*```\{include\} \.\./(?P<file>\w+\.md)\n(?::[^\n]*\n)*```\s*")
_LINK = re.compile(
    r"(?P<picture>!?)\[(?P<text>[^\]]*)\]"
    r"\((?!https?:|#)(?P<file>[^)#\s]+)(?P<at>#[^)\s]+)?\)"
)


def inside(text: str, written: Path, page: Path, docs: Path) -> str:
    """A text with its links turned, as a page has to have them that shows it.

    `written` is the file that the text is of.
    """
    back = "../" * len(page.relative_to(docs).parts[:-1])

    def turned(link: re.Match[str]) -> str:
        target = (written.parent / link["file"]).resolve()
        if target.is_relative_to(docs):
            place = back + target.relative_to(docs).as_posix() if written != page else link["file"]
        elif not target.exists():
            return link[0]  # the build says so
        else:
            name = target.relative_to(docs.parent).as_posix()
            if name not in SHOWN or not (docs / SHOWN[name]).exists():
                return link["text"]
            place = back + SHOWN[name]
        return f"{link['picture']}[{link['text']}]({place}{link['at'] or ''})"

    return _LINK.sub(turned, text)


def _read(app: Sphinx, name: str, source: list[str]) -> None:
    docs = Path(app.srcdir).resolve()
    page = written = Path(app.env.doc2path(name)).resolve()
    if page.suffix != ".md":
        return
    whole = _WHOLE.fullmatch(source[0])
    if whole:
        written = docs.parent / whole["file"]
        source[0] = written.read_text()
        app.env.note_dependency(written)
    source[0] = inside(source[0], written, page, docs)


def setup(app: Sphinx) -> dict[str, bool]:
    """Before a page is parsed."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
