"""docs/extending.md does what it says: its code runs as printed and meets the contracts."""

import contextlib
import inspect
import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

import mann_torch as mt
from mann_torch.memory import KEY_RULES
from tests import conftest
from tests.contracts import test_cell_contract, test_cell_inputs, test_memory_contract


def _args(function: object) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters) if callable(function) else ()


PAGE = (Path(__file__).parent.parent / "docs" / "extending.md").read_text()
CHECKS: dict[str, Callable[[str, str], None]] = {
    f"{module.__name__.rsplit('_', 2)[1]}-{name}": check
    for module in (test_memory_contract, test_cell_contract, test_cell_inputs)
    for name, check in vars(module).items()
    if name.startswith("test_") and {"attention", "rule"} <= set(_args(check))
}
PAIRS = [
    ("k_nearest", "representation"),
    ("k_nearest", "direction"),
    ("soft", "direction"),
    ("euclidean", "direction"),
]


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """All that the page's snippets define, run in their order."""
    names: dict[str, Any] = {}
    torch.manual_seed(0)
    snippets = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    assert len(snippets) == 4
    for snippet in snippets:
        exec(compile(snippet, "docs/extending.md", "exec"), names)
    return names


@pytest.fixture(autouse=True)
def _registered(page: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(conftest.ATTENTION_MAKERS, "k_nearest", page["KNearestAttention"])
    monkeypatch.setitem(conftest.ATTENTION_MAKERS, "euclidean", page["EuclideanAttention"])
    monkeypatch.setitem(KEY_RULES, "direction", page["DirectionKeys"])


@pytest.mark.parametrize(("attention", "rule"), PAIRS)
@pytest.mark.parametrize("name", CHECKS)
def test_the_pages_parts_meet_the_contract(name: str, attention: str, rule: str) -> None:
    CHECKS[name](attention, rule)


def test_the_contract_has_not_shrunk() -> None:
    assert len(CHECKS) >= 22


def test_the_page_shows_a_gradient_and_two_slots(page: dict[str, Any]) -> None:
    slope = page["cell"].memory.attention.temperature.grad
    assert bool(torch.isfinite(slope)) and float(slope) != 0.0
    seen = page["cell"].attend(torch.randn(20, 3), page["cell"].initial_state(20))
    assert bool(((seen.weights > 0).sum(-1) == 2).all())
    assert issubclass(page["KNearestAttention"], mt.Attention)


def test_the_memory_pages_ode_is_one_step_of_the_cell() -> None:
    page = (Path(__file__).parent.parent / "docs" / "memory.md").read_text()
    (snippet,) = re.findall(r"```python\n(.*?)```", page, re.S)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(snippet, "docs/memory.md", "exec"), {})
    assert 0.0 <= float(printed.getvalue()) < 1e-6
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", page)
    assert len(pictures) >= 2
    assert all((Path(__file__).parent.parent / "docs" / name).exists() for name in pictures)
