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


#: A number that a reader may change, and what the picture's axes then show: of which, and up to.
CHANGED = {
    "plot_12_recall": ("5, 8, 8, 300", "5, 8, 6, 40", {0: ("x", 40.0), 1: ("x", 6.5)}),
    "plot_02_attention": (
        "S, horizon, jumps = 5, 60.0",
        "S, horizon, jumps = 3, 12.0",
        {0: ("y", 3.5), 1: ("y", 3.5), 2: ("x", 12.0)},
    ),
    "plot_01_arm_payload": ("50.0, [15.0, 35.0]", "12.0, [3.0, 6.0]", {1: ("x", 12.0)}),
}


#: For every test run; the other is for `make check`.
_QUICK = ("plot_12_recall", "plot_02_attention")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in _QUICK else [pytest.mark.slow]) for n in CHANGED]
)
def test_a_picture_follows_a_number_that_a_reader_changes(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("agg")
    (path,) = (path for path in EXAMPLES if path.stem == name)
    there, instead, limits = CHANGED[name]
    source = path.read_text()
    assert source.count(there) == 1
    with plt.rc_context():
        exec(compile(source.replace(there, instead), path.name, "exec"), {"__name__": name})
        figure = plt.gcf()
    plt.close(figure)
    for number, (which, most) in limits.items():
        ax = figure.axes[number]
        low, high = getattr(ax, f"get_{which}lim")()
        assert 0.9 * most <= max(low, high) <= 1.05 * most, (number, low, high)
        inside = [t for t in getattr(ax, f"get_{which}ticks")() if low <= t <= high]
        assert len(inside) >= 3 and (most % 1 == 0 or max(inside) == most - 0.5)


def test_the_gallery_says_how_to_keep_a_picture_without_a_screen() -> None:
    said = (ROOT / "docs" / "gallery" / "README.rst").read_text()
    assert "MPLBACKEND=agg" in said and "plt.savefig" in said
    assert all(path.read_text().endswith("plt.show()\n") for path in EXAMPLES)


def test_a_line_of_code_is_counted_as_one() -> None:
    assert code_lines('"""Text.\n\nMore."""\n\nx = 1  # one\n# none\ny = [\n    1,\n]\n') == 4
