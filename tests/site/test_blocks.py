"""Every block of code on every page is run: in the build, or by the tests named here."""

import re
import tomllib
from xml.etree import ElementTree

import pytest
import yaml

from tests.site.pages import ROOT, Block, blocks, pages

TESTS = {
    path.relative_to(ROOT).as_posix(): path.read_text()
    for path in sorted((ROOT / "tests").rglob("test_*.py"))
    if path.name != "test_blocks.py"
}
#: What shows something and runs nothing.
SHOWN = ("text", "")
READ = {
    "yaml": yaml.safe_load,
    "toml": tomllib.loads,
    "xml": lambda text: ElementTree.fromstring(f"<page>{text}</page>"),
}


def runners(page: str) -> list[str]:
    """The tests that run a page's Python, or compile what else it shows."""
    runs = re.compile(r"\b(executed|exec|text_of)\(")
    named = page if page != "README.md" else "README"
    folder = f'executed(f"{page.rpartition("/")[0]}/{{' if "/" in page else "\0"
    quoted = re.compile(rf"[\"']{re.escape(named)}[\"']|\b{re.escape(named)}\b =")
    return [
        name
        for name, text in TESTS.items()
        if folder in text or (quoted.search(text) and runs.search(text))
    ]


def is_executed_in_the_build(page: str) -> bool:
    """Whether myst-nb takes a page for a notebook."""
    head = re.match(r"---\n(.*?)\n---\n", pages()[page].read_text(), re.S)
    return head is not None and "mystnb" in head[1]


def who_runs(block: Block) -> str | None:
    """Who runs a block; None for one that nobody does."""
    language = block.language
    if language.startswith("{code-cell}"):
        return "make docs" if is_executed_in_the_build(block.page) else None
    if language.startswith("{") or language in SHOWN:
        return "nothing to run"
    if language == "sh":
        return "tests/site/test_commands.py"
    if language in READ:
        READ[language](block.body)
        return "tests/site/test_blocks.py"
    found = runners(block.page)
    return found[0] if found else None


@pytest.mark.parametrize("block", blocks(), ids=lambda b: f"{b.page}:{b.line}:{b.language}")
def test_somebody_runs_it(block: Block) -> None:
    assert who_runs(block) is not None, f"{block.page}, line {block.line}: nobody runs it"


def test_commands_are_marked_as_commands() -> None:
    for block in blocks():
        if block.language in SHOWN:
            hidden = re.match(r"(python -m|make |pip |mann-)", block.body)
            assert hidden is None, f"{block.page}, line {block.line}: mark it as sh"
        assert block.language, f"{block.page}, line {block.line}: say what it is"


def test_a_block_that_nobody_runs_is_found() -> None:
    assert who_runs(Block("nowhere.md", 1, "python", "1")) is None
    assert who_runs(Block("memory.md", 1, "{code-cell}", "1")) is None
    with pytest.raises(tomllib.TOMLDecodeError):
        who_runs(Block("nowhere.md", 1, "toml", "a ="))
