"""Attentions and key rules of docs/write, as printed there, meet the library's own contracts."""

import inspect
import re
from collections.abc import Callable
from typing import Any

import pytest
import torch

from mann_torch.memory import KEY_RULES, MemoryCell
from mann_torch.testing import check_attention
from tests import conftest
from tests.contracts import test_cell_contract, test_cell_inputs, test_memory_contract
from tests.pages import DOCS, executed, part_of, text_of


def _args(function: object) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters) if callable(function) else ()


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
    """All that the two pages define."""
    names: dict[str, Any] = {}
    for snippet in (
        part_of("write/attention.md", "class KNearestAttention"),
        part_of("write/attention.md", "class EuclideanAttention"),
        part_of("write/key_rule.md", "class DirectionKeys"),
    ):
        exec(compile(snippet, "docs/write", "exec"), names)
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


def test_two_slots_are_attended(page: dict[str, Any]) -> None:
    attention, rule = page["KNearestAttention"](k=2), page["DirectionKeys"](key_rate=2.0)
    cell = MemoryCell(3, 8, 4, attention, rule)
    seen = cell.attend(torch.randn(20, 3), cell.initial_state(20))
    assert bool(((seen.weights > 0).sum(-1) == 2).all())


@pytest.mark.parametrize("name", ["KNearestAttention", "EuclideanAttention"])
def test_each_attention_keeps_its_contract(page: dict[str, Any], name: str) -> None:
    check_attention(page[name](), page["DirectionKeys"]())


def test_the_memory_pages_ode_is_one_step_of_the_cell() -> None:
    assert 0.0 <= float(executed("memory.md")["printed"]) < 1e-6
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text_of("memory.md"))
    assert len(pictures) >= 2 and all((DOCS / name).exists() for name in pictures)
