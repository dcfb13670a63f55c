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
    assert 0.0 <= float(executed("memory.md")["printed"].split()[-1]) < 1e-6


def test_the_memory_pages_example_learns_which_symbol_came_first() -> None:
    found = executed("memory.md")
    symbols = torch.randint(4, (256, 30), generator=torch.Generator().manual_seed(5))
    with torch.no_grad():  # new sequences; an LSTM guesses one of four
        outputs, _ = found["memory"](torch.nn.functional.one_hot(symbols, 4).float())
        right = found["head"](outputs[:, -1]).argmax(-1) == symbols[:, 0]
    assert float(right.double().mean()) > 0.95


def test_pictures_of_the_pages_on_the_memory_are_there() -> None:
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text_of("peers.md"))
    assert len(pictures) >= 5 and all((DOCS / name).exists() for name in pictures)


def test_the_memory_pages_figures_are_those_of_the_tables() -> None:
    """Its five lines repeat numbers of docs/peers.md and BENCHMARKS.md."""
    said = text_of("memory.md").split("```")[0]
    tables = text_of("peers.md").split("## Online")[0].split("\n### ")[1:]
    cells = {}
    for table in tables:
        lines = [line for line in table.splitlines() if line.startswith("| ")]
        head, *rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines]
        cells |= {(table.split()[0], row[0]): dict(zip(head, row, strict=True)) for row in rows}

    def shown(task: str, model: str, column: str) -> str:
        return cells[task, model][column].split()[0]

    iterations = "to its best [iterations]"
    assert f"after {shown('recall', 'memory', iterations)} iterations" in said
    assert f"LSTM: {float(shown('recall', 'lstm', 'accuracy')):.0%}".replace("%", " %") in said
    assert f"after {cells['recall', 'lstm']['iterations']})" in said
    assert f"({shown('gap', 'memory', 'accuracy')}; LSTM: guessing" in said
    assert f"({shown('copy', 'memory', 'accuracy')} at this size" in said
    low, high = (shown(task, "attention", iterations) for task in ("copy", "gap"))
    assert f"in {low} to {high} iterations" in said
    errors = (shown("returning", model, "relative RMSE") for model in ("attention", "memory"))
    assert "({} against {}".format(*errors) in said
    measured = (DOCS.parent / "BENCHMARKS.md").read_text().split("## The memory beside")[1]
    row = next(line for line in measured.splitlines() if line.startswith("| default"))
    (ratio,) = re.findall(r"costs\*\* ([\d.]+) times", said)
    assert abs(float(ratio) - float(row.split("|")[4].split()[0])) < 0.051
