"""Names of the library that a page has in backticks lead to the reference, as docstrings' do."""

from __future__ import annotations

import re

from api import resolver
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

_RESOLVE = resolver(set(), None)
#: Functions that pages call by a word alone; others' are words of their own (`switches`).
_WORDS = {"deploy", "explain", "observe", "rollout", "srmse"}


def place_of(code: str) -> str | None:
    """Where the reference has it: a class, a call, or a name that could be no other word."""
    if code in _WORDS or re.search(r"[A-Z._(]", code):
        place: str | None = _RESOLVE(code)
        return place
    return None


def link_names(app: Sphinx, document: nodes.document) -> None:
    """Wrap them in references; headings and links stay what they are."""
    if app.env.current_document.docname.startswith("api/"):
        return
    for found in list(document.findall(nodes.literal)):
        parent, place = found.parent, place_of(found.astext())
        while parent and not isinstance(parent, nodes.title | nodes.reference | pending_xref):
            parent = parent.parent
        if place is None or parent:
            continue
        link = pending_xref(
            "",
            refdomain="py",
            reftype="obj",
            reftarget=place,
            refexplicit=True,
            refwarn=True,
            refdoc=app.env.current_document.docname,
        )
        found.replace_self(link)
        link += found


def setup(app: Sphinx) -> dict[str, bool]:
    """Once a page is read."""
    app.connect("doctree-read", link_names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
