"""The gradient report: its verdicts, and a short run of all of it."""

import csv
import json
import math
from pathlib import Path

import pytest

from experiments import gradient_report
from experiments.gradients.elasticities import verdict
from experiments.runs.intervals import Interval
from tests.experiments.command import exit_code

SHORT = ["horizon=0.2", "draws=3", "horizons=[0.1]", "temperatures=[0.1]", "steps=[0.1]"]
SHORT += ["solver.engine=torch"]  # nothing to compile


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    return exit_code(monkeypatch, gradient_report.main, *arguments)


@pytest.mark.parametrize(
    ("mode", "judge", "said"),
    [
        ((-0.9, 0.01), (-0.89, 0.02), "agrees"),
        ((-0.9, 0.01), (-0.80, 0.02), "biased by -0.100"),
        ((0.9, 0.01), (-0.89, 0.02), "wrong sign"),
        ((0.0, 0.0), (-0.89, 0.02), "no gradient: exactly 0"),
        ((0.0, 0.0), (0.01, 0.02), "no signal"),
        ((0.01, 0.02), (0.0, 0.02), "no signal"),
        ((0.01, 0.005), (0.0, 0.02), "agrees"),
        ((5.0, 9.0), (-0.89, 0.02), "too wide to tell"),
    ],
)
def test_verdicts(mode: tuple[float, float], judge: tuple[float, float], said: str) -> None:
    assert verdict(Interval(*mode), Interval(*judge)) == said


@pytest.mark.slow
def test_a_report_has_every_mode_constant_and_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "run"
    names = "names=[write_gain,shift_threshold,error_gain]"
    arguments = ["scenario=4", "controller=hard", names, *SHORT, f"run_dir={folder}"]
    assert run(monkeypatch, *arguments) == 0
    with open(folder / "elasticities.csv") as file:
        rows = list(csv.DictReader(file))
    # hard attention has no theta: it is left out
    assert {row["constant"] for row in rows} == {"write_gain", "error_gain"}
    assert {row["mode"] for row in rows} == {
        "fd 10 %",
        "smoothed",
        "plain",
        "hybrid",
        "soft T = 0.1",
    }
    found = {(r["constant"], r["mode"]): float(r["elasticity"]) for r in rows}
    judged, plain = (found["error_gain", mode] for mode in ("fd 10 %", "plain"))
    assert math.isclose(judged, plain, rel_tol=0.1)  # smooth there, at so short a horizon
    metrics = json.loads((folder / "metrics.json").read_text())
    assert [h for h, _ in metrics["norms"]["plain"]] == [0.1, 0.2]
    assert len(metrics["switches"]) == 3
    report = (folder / "report.md").read_text()
    assert "lies inside the interval" in report and "norm of the gradient" in report
    assert {path.name for path in folder.glob("*.png")} == {"landscape.png", "norms.png"}


@pytest.mark.parametrize(
    "setting",
    [
        "names=[theta]",
        "names=[]",
        "draws=1",
        "of_output=3",
        "judge=0.2",
        "steps=[]",
        "steps=[0.1,-1]",
        "spread=nan",
        "pairs=0",
        "temperatures=[0]",
        "horizons=[-1]",
        "constants.rate_W=-1",
        "scenario=9",
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    setting: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    given = [s for s in SHORT if s.split("=")[0] != setting.split("=")[0]]
    assert run(monkeypatch, *given, setting, f"run_dir={tmp_path / 'run'}") == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ") and captured.err.count("\n") == 1
    assert not (tmp_path / "run").exists()
