"""Links that show a page's file name, as is right in the repository, show its title on the site."""

from __future__ import annotations

import posixpath
import re

from docutils import nodes
from sphinx.application import Sphinx

_FILE = re.compile(r"[\w/.]+\.md")


def show_titles(app: Sphinx, document: nodes.document, page: str) -> None:
    """Put the title in place of the name."""
    for link in document.findall(nodes.reference):
        place, _, _ = link.get("refuri", "").partition("#")
        if not (link.get("internal") and place and _FILE.fullmatch(link.astext())):
            continue
        target = posixpath.normpath(posixpath.join(posixpath.dirname(page), place))
        title = app.env.titles[target.removesuffix(".html")].astext()
        link.children = [nodes.inline("", title)]


def setup(app: Sphinx) -> dict[str, bool]:
    """Once links are resolved."""
    app.connect("doctree-resolved", show_titles)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
