"""Pages beside those of parts: they run as printed, and what they say of the library is so."""

from __future__ import annotations

import ast
import inspect
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control, memory, parts, plants, signals, types
from mann_torch.memory import ReallocatingAttention, StateKeys
from mann_torch.testing import __all__ as checks
from tests.pages import DOCS, executed, pieces_of, text_of

ROOT = DOCS.parent
pytest.importorskip("gymnasium")


@pytest.mark.parametrize("name", ["choosing.md", "coming_from.md", "faq.md", "how_we_test.md"])
def test_a_page_runs_compiled(name: str) -> None:
    assert pieces_of(name)
    found = executed(name)
    runs = [value for value in found.values() if isinstance(value, mt.Trajectory)]
    assert all(run.engine == "compiled" for run in runs)
    assert runs or name in ("choosing.md", "how_we_test.md")


@pytest.mark.slow
def test_the_first_hour_runs() -> None:
    found = executed("first_hour.md")
    assert found["run"].engine == "compiled"
    told = re.findall(r"([-\d.]+) mrad\n", found["printed"].split("d SRMSE")[1])
    plain, *differences = (float(x) for x in told[-4:])
    far, _, near = differences
    assert near == pytest.approx(plain, rel=1e-3) and far == pytest.approx(plain, rel=0.02)
    assert found["history"][-1] < 0.8 < found["history"][0]


def test_the_faqs_sample_diverges_alone() -> None:
    run = executed("faq.md")["run"]
    assert run.status.tolist()[0] == 0 and run.status.tolist()[1] != 0
    assert bool(mt.srmse(run)[0].isfinite().all() and mt.srmse(run)[1].isnan().all())


def test_what_was_learned_goes_on() -> None:
    found = executed("faq.md")
    assert float(found["apart"]) < 1e-12
    in_one_go, goes_on = mt.srmse(found["whole"]), mt.srmse(found["second"])
    assert bool((goes_on < 0.9 * in_one_go).all())  # what errs at first is behind it


def test_other_programs_agree() -> None:
    found = executed("coming_from.md")
    assert float(found["apart"]) < 1e-9
    assert float(found["late"]) < 0.5 * float(found["early"])
    slopes = found["masses"].grad
    assert bool((slopes != 0).all() and slopes.isfinite().all())


# --- messages of the FAQ -------------------------------------------------------------------


def _said(node: ast.AST) -> str:
    """A text of the source, a `...` for what is put in."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else "..."
    if isinstance(node, ast.JoinedStr):
        return "".join(map(_said, node.values))
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _said(node.left) + _said(node.right)
    return "..."


@cache
def library_texts() -> list[str]:
    found = []
    for path in (ROOT / "mann_torch").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant | ast.JoinedStr | ast.BinOp):
                found.append(" ".join(_said(node).split()))
    return [text for text in found if len(text) > 8]


def is_said(message: str) -> bool:
    """Whether one text of the library has the words of a message, in their order."""
    pieces = [
        piece
        for piece in re.sub(r"\b\d+\b", "...", message).split("...")
        if piece.strip(" :;,'()") != ""
    ]
    pattern = ".*".join(re.escape(" ".join(piece.split())) for piece in pieces)
    return any(re.search(pattern, text) for text in library_texts())


def messages_of(name: str) -> list[str]:
    """First cells of tables whose heading says that they are messages."""
    found, inside = [], False
    for line in text_of(name).splitlines():
        if line.startswith("|"):
            cell = line.split(" | ")[0].strip("| ")
            inside = inside or "message" in cell
            if inside and cell.startswith("`"):
                found.append(cell.strip("`"))
        else:
            inside = False
    return found


@pytest.mark.parametrize(
    "name", ["faq.md", *(f"write/{path.name}" for path in (DOCS / "write").glob("*.md"))]
)
def test_every_message_is_one_of_the_librarys(name: str) -> None:
    messages = messages_of(name)
    assert len(messages) >= 4
    assert [message for message in messages if not is_said(message)] == []


def test_a_message_that_nobody_says_is_found_out() -> None:
    assert not is_said("the moon is ... of cheese")
    assert is_said("horizon = ...: must be finite and > 0")


def test_the_faq_has_every_named_error() -> None:
    headings = " ".join(re.findall(r"^## (.*)$", text_of("faq.md"), re.M))
    for name, kind in vars(mt.errors).items():
        if inspect.isclass(kind) and issubclass(kind, mt.MannError) and name != "MannError":
            assert name in headings, name


# --- the glossary --------------------------------------------------------------------------


def test_the_glossary_has_every_constant_of_the_papers_with_its_default() -> None:
    made = mt.WorkingMemory(5, 10, ReallocatingAttention(), StateKeys(), context_width=2)
    rows = [line for line in text_of("glossary.md").splitlines() if line.startswith("| ")]
    for name, value in mt.MannController(2, 10, made).constants().items():
        (row,) = (row for row in rows if f"`{name}`" in row)
        cells = [cell.strip() for cell in row.split("|")]
        number = value.detach().diagonal()[0] if value.dim() == 2 else value.detach()
        assert any(float(number) == _number(cell) for cell in cells[5].split(",")), row


def _number(text: str) -> float | None:
    found = re.match(r"\s*(-?[\d.]+)", text)
    return None if found is None else float(found[1])


def test_the_glossarys_places_are_there() -> None:
    homes: list[Any] = [mt, control, memory, parts, plants, signals, types]
    section = text_of("glossary.md").split("## Words")[0]
    for row in re.findall(r"^\| .*\|$", section, re.M):
        place = row.rstrip("| ").rsplit("|", 1)[-1].strip()
        for name in re.findall(r"`(\w+)[\w.]*`", place):
            assert any(hasattr(home, name) for home in homes), name


# --- choosing, testing ---------------------------------------------------------------------


def test_what_is_chosen_from_is_there() -> None:
    page = text_of("choosing.md")
    for name in control.LAW_PARTS.values():
        assert name.__name__ in page or name.__name__ == "ConstantGain", name
    for kind in control.CONTROLLERS.values():
        assert kind.__name__ in page, kind
    for name in memory.ATTENTIONS.values():
        assert name.__name__ in page, name


def test_the_page_on_tests_names_places_that_are_there() -> None:
    page = text_of("how_we_test.md")
    places = set(re.findall(r"`(tests/[\w./]+)`", page))
    assert len(places) > 8 and all((ROOT / place).exists() for place in places)
    shown = set(re.findall(r"\b(check_\w+)\b", page))
    assert shown <= {*checks, "check_*"} and len(shown) >= 6


def test_links_of_these_pages_lead_somewhere() -> None:
    """Files alone: anchors are the build's."""
    later = {"tuning.md", "gradients.md", "reproduction.md"}
    pages = [*DOCS.glob("write/*.md")]
    pages += [DOCS / f"{name}.md" for name in ("first_hour", "choosing", "coming_from")]
    pages += [DOCS / f"{name}.md" for name in ("faq", "glossary", "how_we_test")]
    for page in pages:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
            if "://" in target or Path(target).name in later:
                continue
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_shown_output_is_held_to_what_is_printed() -> None:
    assert Tensor is torch.Tensor  # what pages print of them is text
    shown = [piece for piece in pieces_of("coming_from.md") if piece.shown]
    assert len(shown) == 5
