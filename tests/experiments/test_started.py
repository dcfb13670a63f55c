"""A command speaks of itself as it was called."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from experiments import collect, simulate
from experiments.command.help_texts import help_text
from experiments.command.overrides import MOST_JOBS, jobs_of
from experiments.command.started import arguments_of, as_started
from experiments.records.recording import run_name
from mann_torch.errors import ConfigError

INSTALLED = "/somewhere/bin/mann-simulate"


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (INSTALLED, ["mann-gradient-report"]),
        ("mann-simulate.exe", ["mann-gradient-report"]),
        pytest.param(
            "/checkout/experiments/simulate.py",
            ["python", "-m", "experiments.gradient_report"],
            marks=pytest.mark.checkout,
        ),
    ],
)
def test_another_command_is_called_as_this_one_was(
    program: str, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [program])
    assert as_started("gradient_report") == words
    assert arguments_of(" ".join([*words, "a=1", "'b c'"])) == ["a=1", "b c"]
    assert f"  {' '.join(words)} " in help_text("gradient_report").replace("example     ", "  ")


def test_an_installed_command_writes_its_own_name_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    quick = ["horizon=0.02", "output.figures=false", "run_dir=sweep"]
    told = ["-m", "controller=nn,soft", *quick]
    monkeypatch.setattr(sys, "argv", [INSTALLED, *told])
    simulate.main()
    record = json.loads((tmp_path / "sweep" / "0" / "metrics.json").read_text())
    said = "mann-simulate controller=nn horizon=0.02 output.figures=False run_dir=sweep"
    assert record["command"] == said  # false as Hydra writes it
    (events,) = (tmp_path / "sweep" / "0").rglob("events.out.tfevents.*")
    assert events.parent.name == run_name(record["command"]) == "controller=nn,horizon=0.02"
    page = (tmp_path / "sweep" / "sweep.md").read_text()
    assert page.startswith(f"`mann-simulate {' '.join(told)}`\n")
    assert not list(tmp_path.rglob("*.log"))  # nothing was said that would be in it
    monkeypatch.setattr(sys, "argv", ["mann-collect", "sweep", "--out", "again"])
    collect.main()
    assert (tmp_path / "again" / "sweep.md").read_text().startswith("`mann-collect sweep ")
    assert "experiments." not in capsys.readouterr().out


def test_too_large_a_sweep_names_the_command_that_collects(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "argv", [INSTALLED])
    seeds = f"seed=range({MOST_JOBS + 1})"
    with pytest.raises(ConfigError, match=r"one table of them with mann-collect$"):
        list(jobs_of(["-m", seeds]))


def test_no_help_names_a_file_of_a_checkout() -> None:
    for command in ("simulate", "reproduce", "tune", "export"):
        assert "tests/" not in help_text(command)
