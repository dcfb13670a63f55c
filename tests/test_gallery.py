"""The gallery: every example is short, says what it shows, and makes its figure when it is run."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "docs" / "gallery").glob("plot_*.py"))
#: A line of code is neither empty, nor a comment, nor a docstring's.
MOST_LINES = 40

#: Runs one example; prints how many figures it leaves, and how many of their axes hold data.
_RUN = """
import runpy, sys
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
runpy.run_path(sys.argv[1])
figures = [plt.figure(number) for number in plt.get_fignums()]
for figure in figures:
    figure.canvas.draw()
axes = [ax for figure in figures for ax in figure.axes]
print("figures", len(figures), sum(ax.has_data() for ax in axes))
print("labels", all(ax.get_xlabel() or ax.get_ylabel() for ax in axes if ax.has_data()))
"""


def code_lines(source: str) -> int:
    """How many lines of code there are."""
    told: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            told |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    rows = enumerate(source.splitlines(), 1)
    return sum(bool(row.strip()) and row.strip()[0] != "#" and n not in told for n, row in rows)


def test_there_are_fifteen_or_more() -> None:
    assert len(EXAMPLES) >= 15


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_is_short_and_says_what_is_seen(path: Path) -> None:
    source = path.read_text()
    title, bar, blank, *text = (ast.get_docstring(ast.parse(source)) or "").splitlines()
    assert code_lines(source) <= MOST_LINES
    assert set(bar) == {"="} and len(bar) == len(title) and not blank
    assert 3 <= len(text) <= 6
    assert 'plt.style.use("mann_torch.paper")' in source


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_makes_its_figure(path: Path) -> None:
    if path.stem.endswith("mujoco"):
        pytest.importorskip("mujoco")
    if path.stem.endswith("policy"):
        pytest.importorskip("gymnasium")
    found = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:mann_torch", "-c", _RUN, str(path)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        cwd=path.parent,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert found.returncode == 0, found.stderr[-2000:]
    told = dict(line.split(" ", 1) for line in found.stdout.splitlines() if " " in line)
    figures, filled = map(int, told["figures"].split())
    assert figures == 1 and filled >= 1
    assert told["labels"] == "True"


def test_a_line_of_code_is_counted_as_one() -> None:
    assert code_lines('"""Text.\n\nMore."""\n\nx = 1  # one\n# none\ny = [\n    1,\n]\n') == 4
