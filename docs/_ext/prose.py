"""The library's docstrings, plain text with backticks, as reStructuredText."""

from __future__ import annotations

import re
from collections.abc import Callable

from equations import latex, with_equations

#: Gives the full name that a name in backticks links to, or None.
Resolve = Callable[[str], str | None]

_TICKED = re.compile(r"``(?P<code>[^`]+)``|`(?P<name>[^`]+)`")
_ITEM = re.compile(r"(?P<mark>\d+\.|-) (?P<text>.*)")
_SECTION = re.compile(r"(Args|Raises|Returns|Yields):$")
_ENTRY = re.compile(r"(?P<name>\*{0,2}\w+): (?P<text>.*)")


def escaped(text: str) -> str:
    """Plain text that means itself."""
    text = re.sub(r"([\\*`|])", r"\\\1", text)
    text = re.sub(r"_(?!\w)", r"\\_", text)
    return re.sub(r"::(?=\s*$)", r"\:\:", text)


def inline(text: str, resolve: Resolve) -> str:
    """A paragraph: code stays code, public names link, equations are set."""
    text = re.sub(r"\s*\n\s*", "\n", text.strip())
    made, at = [], 0
    for ticked in _TICKED.finditer(text):
        made.append(with_equations(text[at : ticked.start()], escaped))
        at = ticked.end()
        code = ticked["code"] or ticked["name"]
        target = resolve(code) if ticked["name"] else None
        code = re.sub(r"\s*\n\s*", " ", code)
        link = f":py:obj:`{code} <{target}>`" if target else f"``{code}``"
        made.append(f"\\ {link}\\ ")
    made.append(with_equations(text[at:], escaped))
    whole = "".join(made)
    whole = re.sub(r"(^|\s)\\ ", r"\1", whole)
    whole = re.sub(r"\\ (?=\s|$)", "", whole)
    # What starts as a list, a field or a directive would is none.
    odd = re.match(r"\w{1,4}[.)]|[-+*#.:>=(\[]", whole)
    if odd and not whole.startswith((":py:", ":math:")):
        return f"\\ {whole}"
    return whole


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _block(lines: list[str], start: int, least: int) -> int:
    """Where the block that is indented by `least` or more ends; blank lines may lie within."""
    end = at = start
    while at < len(lines) and (not lines[at].strip() or _indent(lines[at]) >= least):
        at += 1
        if lines[at - 1].strip():
            end = at
    return end


def _equation(lines: list[str]) -> list[str]:
    """An indented block: an equation if it reads as one, else as it is."""
    rows = [row.strip().rstrip(",") for row in lines]
    set_rows = [latex(row) for row in rows if row]
    if all(set_rows):
        return [".. math::", "", "   " + r" \\ ".join(row or "" for row in set_rows), ""]
    least = min(_indent(row) for row in lines if row.strip())
    return [".. code-block:: text", "", *(f"   {row[least:]}" for row in lines), ""]


def _fields(head: str, lines: list[str], resolve: Resolve) -> list[str]:
    """The entries of an `Args:` or `Raises:`."""
    least = min(_indent(row) for row in lines if row.strip())
    made: list[str] = []
    entries: list[tuple[str, list[str]]] = []
    for row in (row[least:] for row in lines):
        entry = _ENTRY.match(row) if _indent(row) == 0 else None
        if entry:
            entries.append((entry["name"], [entry["text"]]))
        elif entries:
            entries[-1][1].append(row.strip())
        else:
            entries.append(("", [row.strip()]))
    word = {"Args": "param", "Raises": "raises"}.get(head, "returns")
    for name, text in entries:
        field = f":{word} {escaped(name)}:" if name else f":{word}:"
        told = inline("\n".join(text), resolve).replace("\n", " ")
        made.append(f"{field} {told.removeprefix(chr(92) + ' ')}")
    return [*made, ""]


def _table(lines: list[str], resolve: Resolve) -> list[str]:
    """A table with bars, as Markdown has it."""
    rows = [row.strip().strip("|").split("|") for row in lines]
    made = [".. list-table::", "   :header-rows: 1", ""]
    for row in (rows[0], *rows[2:]):
        for at, cell in enumerate(row):
            told = inline(cell, resolve).replace("\n", " ")
            made.append(f"   {'-' if at else '* -'} {told}".replace("   - ", "     - "))
    return [*made, ""]


def restructured(lines: list[str], resolve: Resolve) -> list[str]:
    """A docstring's lines as reStructuredText."""
    made: list[str] = []
    at = 0
    while at < len(lines):
        line = lines[at]
        if not line.strip():
            at += 1
            continue
        if line.startswith(">>> "):
            end = at
            while end < len(lines) and lines[end].strip():
                end += 1
            made += [*lines[at:end], ""]
        elif line.startswith("| ") and line.rstrip().endswith("|"):
            end = at
            while end < len(lines) and lines[end].startswith("|"):
                end += 1
            made += ["", *_table(lines[at:end], resolve)]
        elif section := _SECTION.match(line):
            end = _block(lines, at + 1, 1)
            made += ["", *_fields(section[1], lines[at + 1 : end], resolve)]
        elif _indent(line) >= 2:
            end = _block(lines, at, 2)
            made += _equation(lines[at:end])
        elif item := _ITEM.match(line):
            mark = item["mark"]
            end = _block(lines, at + 1, 2)
            inner = [item["text"]]
            deep = [row for row in lines[at + 1 : end] if row.strip()]
            pad = " " * (len(mark) + 1)
            least = min((_indent(row) for row in deep), default=2)
            rest = [row[least:] for row in lines[at + 1 : end]]
            # The first rows go on with the item's sentence; what follows a blank line is its own.
            while rest and rest[0].strip() and _indent(rest[0]) == 0:
                inner.append(rest.pop(0))
            text = inline("\n".join(inner), resolve).split("\n")
            made += [f"{mark} {text[0]}", *(pad + row for row in text[1:])]
            if any(row.strip() for row in rest):
                made += ["", *(pad + row if row else "" for row in restructured(rest, resolve))]
            if end >= len(lines) or not _ITEM.match(lines[end]):
                made.append("")
        else:
            end = at
            while (
                end < len(lines)
                and lines[end].strip()
                and (end == at or (_indent(lines[end]) < 2 and not _ITEM.match(lines[end])))
                and not (lines[end].startswith("| ") and lines[end].rstrip().endswith("|"))
            ):
                end += 1
            made += [*inline("\n".join(lines[at:end]), resolve).split("\n"), ""]
        at = max(end, at + 1)
    return made
