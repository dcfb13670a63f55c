"""What the README shows is what happens."""

import contextlib
import io
import re
from pathlib import Path

from experiments.reproduction import tables

README = (Path(__file__).parent.parent / "README.md").read_text()


def test_the_first_snippet_prints_a_gradient() -> None:
    snippet = re.findall(r"```python\n(.*?)```", README, re.S)[0]
    assert len(snippet.strip().splitlines()) <= 20
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(snippet, "README.md", "exec"), {})
    label, value = printed.getvalue().strip().rsplit(" ", 1)
    assert "c_w" in label and float(value) != 0.0


def test_the_tuners_snippet_lowers_a_judge_of_ones_own() -> None:
    first, second = re.findall(r"```python\n(.*?)```", README.split("## The memory")[0], re.S)
    names: dict[str, object] = {}
    printed = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(first, "README.md", "exec"), names)
    with contextlib.redirect_stdout(printed):
        exec(compile(second, "README.md", "exec"), names)
    told = [float(line) for line in printed.getvalue().split()]
    assert len(told) == 10 and told[-1] < 0.95 < told[0]


def test_the_memorys_snippet_runs_as_printed() -> None:
    (snippet,) = re.findall(
        r"## The memory alone\n.*?```python\n(.*?)```", README.split("## Two engines")[0], re.S
    )
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(snippet, "README.md", "exec"), {})
    shapes, value = printed.getvalue().strip().rsplit(" ", 1)
    assert shapes.startswith("torch.Size([32, 20, 3]) torch.Size([32, 8, 16])")
    assert float(value) > 0.0


def test_the_readme_has_the_result_and_a_figure() -> None:
    line = re.search(
        r"(\d+) of the paper's 46 figures come out within 10 %, (\d+) within 5", README
    )
    assert line is not None
    assert int(line[1]) >= tables.TARGET[0] and int(line[2]) >= tables.TARGET[1]
    shown = re.findall(r"\(([+-][\d.]+) %\)", README)
    assert len(shown) == 46
    assert sum(abs(float(x)) <= 10.0 for x in shown) == int(line[1])
    assert sum(abs(float(x)) <= 5.0 for x in shown) == int(line[2])
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)
    assert pictures
    assert all((Path(__file__).parent.parent / picture).exists() for picture in pictures)
