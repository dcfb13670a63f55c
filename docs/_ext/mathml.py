"""Mathematics as MathML, which browsers set by themselves: no script, no font, no network."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.errors import SphinxError


def _set(code: str, block: bool) -> str:
    try:
        tree = latex2mathml.tex2mathml(code, as_block=block)
    except MathError as error:
        raise SphinxError(f"equation {code!r}: {error}") from None
    return str(tree)


def _inline(self: Any, node: nodes.math) -> None:
    self.body.append(_set(node.astext(), block=False))
    raise nodes.SkipNode


def _block(self: Any, node: nodes.math_block) -> None:
    self.body.append(f'<div class="equation">{_set(node.astext(), block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Make `html_math_renderer = "mathml"` known."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
