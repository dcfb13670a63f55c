"""Fields of NamedTuples and dataclasses, with the comments their sources have."""

from __future__ import annotations

import ast
import inspect
import textwrap
from typing import Any

from prose import Resolve, inline
from sphinx.pycode import ModuleAnalyzer


def fields_of(thing: Any) -> dict[str, tuple[str, str]]:
    """Type and comment of each field of a NamedTuple or dataclass, as its source has them."""
    if not isinstance(thing, type) or not (
        hasattr(thing, "_fields") or hasattr(thing, "__dataclass_fields__")
    ):
        return {}
    try:
        source = textwrap.dedent(inspect.getsource(thing))
    except (OSError, TypeError):
        return {}
    rows = source.split("\n")
    (tree,) = (n for n in ast.parse(source).body if isinstance(n, ast.ClassDef))
    found = {}
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            name = node.target.id
            if name.startswith("_"):
                continue
            after = rows[node.end_lineno - 1][node.end_col_offset :].strip()  # type: ignore[operator]
            comment = after.lstrip("#: ") if after.startswith("#") else ""
            above = node.lineno - 2
            while not comment and above >= 0 and rows[above].strip().startswith("#:"):
                above -= 1
            if not comment:
                told = rows[above + 1 : node.lineno - 1]
                comment = " ".join(row.strip().removeprefix("#:").strip() for row in told)
            found[name] = (ast.unparse(node.annotation), comment)
    return found


def shown_fields(thing: Any, resolve: Resolve) -> list[str]:
    """The fields as attributes, each with its comment."""
    made: list[str] = []
    commented = ModuleAnalyzer.for_module(thing.__module__).find_attr_docs()
    for name, (kind, comment) in fields_of(thing).items():
        if (thing.__qualname__, name) in commented and not hasattr(thing, "_fields"):
            continue  # autodoc shows it
        made += [f".. py:attribute:: {name}", f"   :type: {kind}", "   :no-contents-entry:", ""]
        if comment:
            made += [f"   {row}" for row in inline(comment, resolve).split("\n")] + [""]
    return made
