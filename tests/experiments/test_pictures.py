"""Pictures of every command: in the formats asked for, linked in the report, or none."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path

import pytest

from tests.experiments.command import exit_code, logged

STUDY = ["horizon=0.08", "effort_after=0.02", "solver.engine=torch", "names=[error_gain]"]
SHORT = {
    "simulate": ["horizon=0.1", "controller=nn"],
    "ensemble": ["horizon=0.1", "controller=nn", "rollouts=20", "chunk=10", "workers=1"],
    "reproduce": ["experiment=[table_4]", "horizon=0.1", "draws=2", "workers=1"],
    "tune": [*STUDY, "train.draws=[0,1]", "schedule.iterations=1", "judge=false", "grid=null"],
    "gradient_report": [*STUDY, "draws=2", "temperatures=[]", "horizons=[]", "steps=[0.1]"],
    "peers": [
        *("tasks=[recall]", "variants=[memory]", "recall.iterations=3", "tested=8", "seeds=2"),
        "workers=1",
    ],
    "ablation": [
        *("tables=[online]", "online.variants=[plain,wiped_5]", "online.visits=2", "workers=1"),
        *("online.visit_length=2", "online.rates=[10]", "online.seeds=2"),
    ],
    "online_regression": [
        *("variants=[network]", "rates=[1]", "visits=2", "n_functions=2", "seeds=2", "workers=1"),
        *("visit_length=2", "dt=0.05", "window=0.5"),
    ],
    "tune_problems": [
        *("problems=[rohrs]", "train=2", "train_horizon=0.5", "held_out=4", "iterations=2"),
        "workers=1",
    ],
    "returning": [
        *("variants=[plain,memory_1]", "visits=2", "visit_length=1", "window=0.5", "draws=2"),
        "workers=1",
    ],
}


#: As one text on the command line, and as a list.
FORMATS = dict.fromkeys(SHORT, "[svg,pdf]") | {"simulate": "svg,pdf"}
QUICK = ("simulate", "tune")
EVERY = [c if c in QUICK else pytest.param(c, marks=pytest.mark.slow) for c in SHORT]


@pytest.mark.parametrize("command", EVERY)
def test_every_command_draws_in_the_formats_asked_for(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    main = importlib.import_module(f"experiments.{command}").main
    monkeypatch.chdir(tmp_path)
    drawn, bare = tmp_path / "drawn", tmp_path / "bare"
    arguments = [*SHORT[command], f"output.format={FORMATS[command]}", "output.dpi=50"]
    assert exit_code(monkeypatch, main, *arguments, f"run_dir={drawn}") == 0
    assert logged(drawn).Tags()["images"]
    formats = {
        path.suffix for path in drawn.rglob("*.*") if path.suffix in (".png", ".svg", ".pdf")
    }
    assert formats == {".svg", ".pdf"}
    for page in drawn.glob("*.md"):
        links = re.findall(r"!\[\w+\]\(([^)]+)\)", page.read_text())
        assert all((drawn / link).exists() for link in links)
    quiet = ["output.figures=false", "output.tensorboard=false"]
    assert exit_code(monkeypatch, main, *SHORT[command], *quiet, f"run_dir={bare}") == 0
    assert json.loads((bare / "metrics.json").read_text())
    assert not [p for p in bare.rglob("*") if p.suffix == ".png" or "tfevents" in p.name]


@pytest.mark.parametrize("command", SHORT)
def test_odd_formats_are_refused(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    main = importlib.import_module(f"experiments.{command}").main
    monkeypatch.chdir(tmp_path)
    for bad in ("output.format=gif", "output.dpi=1e9", "output.dpi=nan"):
        assert exit_code(monkeypatch, main, bad) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and bad.partition("=")[0] in said
    assert not any(tmp_path.iterdir())
