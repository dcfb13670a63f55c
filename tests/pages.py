"""Pages of the documentation whose code is run."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import torch

DOCS = Path(__file__).parent.parent / "docs"


def text_of(name: str) -> str:
    """A page."""
    return (DOCS / name).read_text()


def snippets_of(name: str) -> list[str]:
    """A page's Python."""
    return re.findall(r"```python\n(.*?)```", text_of(name), re.S)


def executed(name: str) -> dict[str, Any]:
    """All that a page's snippets define, run in their order, and what they print, `printed`."""
    names: dict[str, Any] = {}
    torch.manual_seed(0)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for snippet in snippets_of(name):
            exec(compile(snippet, f"docs/{name}", "exec"), names)
    return {**names, "printed": printed.getvalue()}
