"""The tune command line: what it leaves behind, what it refuses, and that it survives a kill."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from experiments import tune
from experiments.runs import checkpoints
from tests.experiments.command import exit_code, logged

#: The torch engine has nothing to compile.
SHORT = ["horizon=0.08", "effort_after=0.02", "train.draws=[0,1]", "held_out.draws=[2,3]"]
SHORT += ["solver.engine=torch"]
SMALL = [*SHORT, "grid=null", "names=[write_gain,error_gain]"]


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    return exit_code(monkeypatch, tune.main, *arguments)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "run"


def test_a_run_leaves_constants_judgement_and_curves(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*SHORT, "names=[write_gain,error_gain,shift_threshold]", "gradient.mode=plain"]
    arguments += ["matrix_form=scalar"]
    arguments += ["schedule.iterations=3", "held_out.scenarios=['4','6']"]
    assert run(monkeypatch, *arguments, f"run_dir={folder}") == 0
    metrics = json.loads((folder / "metrics.json").read_text())
    assert "shift_threshold" in metrics["silent"] and len(metrics["history"]) == 3
    assert "No signal: " in capsys.readouterr().out
    assert {row["scenario"] for row in metrics["held_out"]} == {"4", "6"}
    constants = json.loads((folder / "constants.json").read_text())["constants"]
    assert constants["error_gain"][0][0] != 5.0 and constants["error_gain"][0][1] == 0.0
    assert constants["shift_threshold"] == pytest.approx(0.2)
    # 26 candidates (start, tuned, grid of 24) x 2 scenarios x 2 draws, and a header
    assert len((folder / "held_out.csv").read_text().splitlines()) == 26 * 4 + 1
    assert {path.name for path in folder.glob("*.png")} == {"progress.png", "pareto.png"}
    assert [e.step for e in logged(folder).Scalars("tune/objective")] == [0, 1, 2]
    before = (folder / "metrics.json").read_bytes()
    assert run(monkeypatch, *arguments, f"run_dir={folder}") == 0  # skipped
    assert run(monkeypatch, f"resume={folder}") == 0  # so too
    assert run(monkeypatch, *arguments, "seed=9", f"run_dir={folder}") == 2
    assert (folder / "metrics.json").read_bytes() == before


@pytest.mark.slow
def test_killed_at_any_moment_and_resumed_it_ends_in_the_same_constants(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [*SMALL, "judge=false", "schedule.iterations=8", "schedule.minibatch=3"]
    whole = folder / "whole"
    assert run(monkeypatch, *arguments, f"run_dir={whole}") == 0
    for number, wait in enumerate((0.0, 0.2)):
        part = folder / f"part{number}"
        command = [sys.executable, "-m", "experiments.tune", *arguments, f"run_dir={part}"]
        process = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(Path(tune.__file__).parents[1])},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        deadline = time.monotonic() + 120
        while not (part / checkpoints.FILE).exists() and time.monotonic() < deadline:
            time.sleep(0.005)
        time.sleep(wait)
        process.send_signal(signal.SIGKILL)
        process.wait()
        if not (part / "metrics.json").exists():
            assert run(monkeypatch, f"resume={part}") == 0
        found = [json.loads((f / "constants.json").read_text()) for f in (whole, part)]
        assert found[0]["constants"] == found[1]["constants"]
        assert [e.step for e in logged(part).Scalars("tune/objective")] == list(range(8))


def test_constants_of_another_run_are_compared(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = folder / "other.json"
    other.parent.mkdir()
    other.write_text(json.dumps({"constants": {"write_gain": 0.9, "error_gain": [[7, 0], [0, 7]]}}))
    arguments = [*SMALL, "schedule.iterations=1", "held_out.scenarios=['2']", f"compare=[{other}]"]
    assert run(monkeypatch, *arguments, f"run_dir={folder / 'run'}") == 0
    rows = json.loads((folder / "run" / "metrics.json").read_text())["held_out"]
    assert [row["candidate"] for row in rows] == ["tuned", "tuned: write_gain, error_gain"]


@pytest.mark.slow
def test_restarts_end_in_a_table_that_tells_the_best(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [*SMALL, "schedule.iterations=2", "held_out.scenarios=['4']", "gradient.mode=plain"]
    swept = ["-m", "restart=0,1,2", "restart_spread=0.5", *arguments, f"run_dir={folder}"]
    assert run(monkeypatch, *swept) == 0
    rows = list(csv.DictReader((folder / "sweep.csv").read_text().splitlines()))
    assert [row["restart"] for row in rows] == ["0", "1", "2"]
    assert len({row["objective_first"] for row in rows}) == 3
    for number, row in enumerate(rows):
        metrics = json.loads((folder / str(number) / "metrics.json").read_text())
        assert float(row["write_gain"]) == metrics["constants"]["write_gain"]
        assert float(row["error_gain_11"]) == metrics["constants"]["error_gain"][0][0]
        assert "error_gain_12" not in row
        changed = metrics["held_out"][0]["srmse"]["mean"]
        assert float(row["held_out_srmse"]) == float(row["tuned_4_srmse"]) == changed
        begun = [float(value) for value in metrics["history"][0]["z"]]
        assert max(map(abs, begun)) < 0.41 + 2 * 0.15  # log 1.5, and steps of Adam
    best = min(rows, key=lambda row: float(row["objective"]))
    assert f"Least objective: run {best['run']} (" in (folder / "sweep.md").read_text()


BAD = {
    "restart=-1": "restart = -1",
    "restart_spread=0": "restart_spread",
    "names=[c_w]": "no design constant 'c_w'",
    "names=[]": "no constant to tune",
    "names=[e_modification]": "can't be tuned from 0",
    "start={rate_W:-1}": "rate_W = -1",
    "start={c_w:1}": "unknown setting 'constants.c_w'",
    "start={rate_W:many}": "start",
    "train.scenarios=[]": "train.scenarios is empty",
    "train.scenarios=['9']": "unknown name '9'",
    "train.scenarios=['1','1']": "each once",
    "train.draws=[]": "train.draws is empty",
    "train.draws=[-1]": "must be >= 0",
    "held_out.scenarios=[]": "held_out.scenarios is empty",
    "matrix_form=cubic": "matrix form",
    "gradient.mode=magic": "gradient mode",
    "gradient.spread=nan": "spread",
    "gradient.pairs=0": "pairs",
    "gradient.control=[theta]": "not tuned",
    "schedule.iterations=0": "iterations",
    "schedule.optimizer=sgd": "optimizer",
    "schedule.curriculum=[1,2]": "curriculum",
    "schedule.curriculum=[[5,10],[2,20]]": "must increase",
    "objective.peak_limit=0": "peak_limit",
    "objective.effort_weight=-1": "effort_weight",
    "sensor.noise.std=[1e-3,-1]": "sensor.noise",
    "sensor.noise.rate=0": "sensor.noise",
    "grid={rate_W:[-1]}": "rate_W",
    "grid={rate_W:much}": "list of numbers",
    "+grid.theta=[1]": "no design constant",
    "grid=7": "grid = 7",
    "start=7": "start = 7",
    "compare=[nowhere.json]": "compare",
    "resume=nowhere": "resume",
    "horizon=-1": "horizon",
    "effort_after=nan": "effort_after",
    "controller=magic": "unknown controller",
    "+other=1": "unknown setting",
}


@pytest.mark.parametrize("setting", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(
    setting: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = [
        s
        for s in SMALL
        if s.split("=")[0] != setting.split("=")[0].removesuffix(".theta").lstrip("+")
    ]
    assert run(monkeypatch, *given, setting, f"run_dir={folder}") == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ") and captured.err.count("\n") == 1
    assert BAD[setting] in captured.err
    assert not folder.exists()


def test_a_damaged_or_foreign_checkpoint_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        run(monkeypatch, *SMALL, "judge=false", "schedule.iterations=1", f"run_dir={folder}") == 0
    )
    (folder / "metrics.json").unlink()
    for content in (b"", b"not a checkpoint", None):
        if content is None:
            torch.save(
                {"z": torch.zeros(7), "optimizer": {}, "history": []}, folder / "checkpoint.pt"
            )
        else:
            (folder / "checkpoint.pt").write_bytes(content)
        capsys.readouterr()
        assert run(monkeypatch, f"resume={folder}") == 2
        assert capsys.readouterr().err.count("\n") == 1
