"""Inventories of other people's documentation, made from short lists: nothing is downloaded.

A list is docs/inventories/NAME.txt: the address, then lines `name role path`; `$` in a path
stands for the name.
"""

from __future__ import annotations

import zlib
from pathlib import Path


def read(path: Path) -> tuple[str, list[tuple[str, str, str]]]:
    """The address, and (name, role, path) of each entry."""
    address, *rows = path.read_text().split("\n")
    entries = [tuple(row.split()) for row in rows if row.strip() and not row.startswith("#")]
    return address.strip(), [(name, role, place) for name, role, place in entries]


def written(path: Path, folder: Path) -> tuple[str, str]:
    """The address and the file `objects.inv` made of a list, as intersphinx takes them."""
    address, entries = read(path)
    rows = "".join(f"{name} py:{role} 1 {place} -\n" for name, role, place in entries)
    head = f"# Sphinx inventory version 2\n# Project: {path.stem}\n# Version: \n"
    head += "# The remainder of this file is compressed using zlib.\n"
    folder.mkdir(parents=True, exist_ok=True)
    made = folder / f"{path.stem}.inv"
    data = head.encode() + zlib.compress(rows.encode())
    if not made.exists() or made.read_bytes() != data:
        made.write_bytes(data)
    return address, str(made)
