"""What the README shows is what happens."""

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import pytest

from experiments.reproduction import tables
from mann_torch.testing import check_plant

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", README, re.S)


def executed(*snippets: str) -> tuple[dict[str, Any], list[str]]:
    """What snippets define, run in their order, and the lines they print."""
    names: dict[str, Any] = {}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for snippet in snippets:
            exec(compile(snippet, "README.md", "exec"), names)
    return names, printed.getvalue().splitlines()


def test_it_is_short_and_has_four_examples_and_a_picture() -> None:
    assert len(README.splitlines()) < 150
    assert len(SNIPPETS) == 4
    assert len(re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)) == 1


def test_simulating_and_tuning_run_as_printed() -> None:
    assert len(SNIPPETS[0].strip().splitlines()) <= 20
    names, lines = executed(*SNIPPETS[:2])
    told, slope = lines[0].rsplit(" ", 1)
    assert told.startswith("compiled") and "c_w" in told and float(slope) != 0.0
    objectives = [float(line) for line in lines[1:]]
    assert len(objectives) == 8 and objectives[-1] < 0.9 < objectives[0] < 1.1
    assert names["tuner"].done


def test_a_plant_of_ones_own_runs_compiled_and_keeps_its_contract() -> None:
    names, (line,) = executed(SNIPPETS[2])
    assert line.startswith("compiled d SRMSE / d lag = ")
    check_plant(names["ship"])
    # A slower hull follows worse.
    assert float(line.rsplit(" ", 1)[1]) > 0.0


def test_the_memory_runs_as_printed() -> None:
    _, (line,) = executed(SNIPPETS[3])
    shapes, value = line.rsplit(" ", 1)
    assert shapes.startswith("torch.Size([32, 20, 3]) torch.Size([32, 8, 16])")
    assert float(value) > 0.0


@pytest.mark.parametrize("target", re.findall(r"\]\(([^)]+)\)", README))
def test_a_link_leads_somewhere(target: str) -> None:
    assert (ROOT / target).exists()


def test_its_figures_are_those_of_the_pages() -> None:
    reproduction = (ROOT / "docs" / "reproduction.md").read_text()
    line = re.search(r"(\d+) of 46 figures within 10 %, (\d+) within 5 %; (\d+) of 29", README)
    assert line is not None
    assert int(line[1]) >= tables.TARGET[0] and int(line[2]) >= tables.TARGET[1]
    shown = [float(x) for x in re.findall(r"\(([+-][\d.]+) %\)", reproduction)]
    assert len(shown) == 46
    assert sum(abs(x) <= 10.0 for x in shown) == int(line[1])
    assert sum(abs(x) <= 5.0 for x in shown) == int(line[2])
    claims = re.findall(r"^\| .+ \| (yes|no) \| .+ \|$", reproduction, re.M)
    assert len(claims) == 29 and claims.count("yes") == int(line[3])
    benchmarks = (ROOT / "docs" / "benchmarks.md").read_text()
    (agree,) = re.findall(r"(\d+) of 100 numbers to their digits", README)
    assert f"**{agree} of 100 numbers agree**" in benchmarks
