"""Examples in docstrings give what they say."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import mann_torch as mt

ROOT = Path(mt.__file__).parent
NAMES = [
    ".".join(("mann_torch", *path.relative_to(ROOT).with_suffix("").parts))
    for path in sorted(ROOT.rglob("*.py"))
    if ">>> " in path.read_text()
]


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_of_a_module_are_as_printed(name: str) -> None:
    found = doctest.testmod(importlib.import_module(name))
    assert found.attempted > 0 and found.failed == 0


def test_there_are_examples() -> None:
    assert "mann_torch.memory.sequences.sequence" in NAMES
