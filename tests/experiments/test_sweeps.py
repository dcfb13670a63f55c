"""Sweeps that add up: one table and one picture of many runs, under every launcher."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from omegaconf import OmegaConf

from experiments import collect, peers, simulate
from experiments.runs.intervals import Interval
from experiments.sweeps import launchers
from experiments.sweeps.gather import Run, differing
from experiments.sweeps.measures import command_of, units_of
from experiments.sweeps.picture import picture
from mann_torch.errors import SolverError
from tests.experiments.command import exit_code

ROOT = Path(__file__).parents[2]
SHORT = ["horizon=0.3", "draws=2", "output.figures=false", "output.tensorboard=false"]
SWEPT = ["-m", "scenario=1,4", "controller=nn,soft", *SHORT]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "sweep"


def table(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "sweep.csv").read_text().splitlines()))


def test_a_sweep_ends_with_one_table_and_one_picture(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(monkeypatch, simulate.main, *SWEPT, f"run_dir={folder}") == 0
    rows = table(folder)
    assert [(row["scenario"], row["controller"]) for row in rows] == [
        ("1", "nn"),
        ("1", "soft"),
        ("4", "nn"),
        ("4", "soft"),
    ]
    # What follows from a scenario or a controller is no column of its own.
    assert list(rows[0])[:4] == ["run", "scenario", "controller", "srmse_q_1"]
    for number, row in enumerate(rows):
        srmse = json.loads((folder / str(number) / "metrics.json").read_text())["srmse"]
        mean = (srmse[0][0] + srmse[1][0]) / 2
        assert float(row["srmse_q_1"]) == pytest.approx(mean, rel=1e-14)
        # Two draws: Student's t with one degree of freedom.
        half = 12.706204736 * abs(srmse[0][0] - srmse[1][0]) / 2
        assert float(row["srmse_q_1_half"]) == pytest.approx(half, rel=1e-8)
        assert row["status"] == "ok"
    page = (folder / "sweep.md").read_text()
    assert page.startswith("`python -m experiments.simulate -m scenario=1,4 controller=nn,soft")
    assert page.count("| ok") == 4 and "| run | scenario | controller |" in page
    assert (folder / "sweep.png").read_bytes().startswith(b"\x89PNG")
    assert "4 of 4 runs finished" in capsys.readouterr().out


def break_nn(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    whole = simulate.simulate

    def broken(cfg: Any) -> Any:
        if cfg.controller["name"] == "nn":
            raise error
        return whole(cfg)

    monkeypatch.setattr(simulate, "simulate", broken)


def test_a_job_that_fails_is_told_and_the_others_go_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    break_nn(monkeypatch, SolverError("it broke"))
    assert exit_code(monkeypatch, simulate.main, *SWEPT, f"run_dir={folder}") == 1
    status = ["failed: it broke", "ok", "failed: it broke", "ok"]
    assert [row["status"] for row in table(folder)] == status
    assert [row["controller"] for row in table(folder)] == ["nn", "soft"] * 2
    assert table(folder)[0]["srmse_q_1"] == "" and "engine" not in table(folder)[0]
    said = capsys.readouterr().err.splitlines()
    lines = [line for line in said if line.startswith("error:")]
    assert "(scenario=1 controller=nn " in lines[0]
    lines = [re.sub(r" \(.*\):", ":", line) for line in lines]
    assert lines == [
        "error: job 0: it broke",
        "error: job 2: it broke",
        "error: 2 of 4 jobs failed",
    ]


def test_an_interrupted_sweep_tells_what_is_missing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    break_nn(monkeypatch, KeyboardInterrupt())
    swept = ["-m", "controller=soft,nn,hard", *SHORT, f"run_dir={folder}"]
    assert exit_code(monkeypatch, simulate.main, *swept) == 130
    rows = [(row["controller"], row["status"]) for row in table(folder)]
    assert rows == [("soft", "ok"), ("nn", "not finished"), ("hard", "not finished")]


def test_sweeps_of_several_folders_are_collected(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, gains in (("a", "0.5,0.75"), ("b", "1.0")):
        swept = ["-m", "controller=soft,hard", f"constants.write_gain={gains}", *SHORT]
        assert exit_code(monkeypatch, simulate.main, *swept, f"run_dir={folder / name}") == 0
    one = (folder / "a" / "sweep.csv").read_bytes()
    assert exit_code(monkeypatch, collect.main, str(folder / "a")) == 0
    assert (folder / "a" / "sweep.csv").read_bytes() == one
    arguments = [str(folder / "a"), str(folder / "b"), "--out", str(folder / "all")]
    assert exit_code(monkeypatch, collect.main, *arguments) == 0
    rows = table(folder / "all")
    assert [row["constants.write_gain"] for row in rows] == ["0.5", "0.75"] * 2 + ["1"] * 2
    assert rows[-1]["run"] == f"{folder}/b/1"
    assert (folder / "all" / "sweep.png").exists()
    capsys.readouterr()


def test_what_cannot_be_collected_is_refused_in_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, command in (("a", "simulate"), ("b", "gradient_report")):
        record = {"command": f"python -m experiments.{command}", "srmse_after_10s": [[1.0, 1.0]]}
        record |= {"srmse": [[1.0, 1.0]] if name == "a" else [1.0], "norms": {}}
        record |= {"switches": [0], "reallocations": [0]}
        record |= {"outputs": [{"name": "q_1", "unit": "rad"}, {"name": "q_2", "unit": "rad"}]}
        (folder / name).mkdir(parents=True)
        (folder / name / "metrics.json").write_text(json.dumps(record))
    (folder / "broken").mkdir()
    (folder / "broken" / "metrics.json").write_text('{"command": ')
    (folder / "empty").mkdir()
    refused = {
        "empty": f"{folder}/empty holds no finished run",
        "broken": f"{folder}/broken holds no finished run",
        "none": f"{folder}/none is not a folder",
        ".": "runs of gradient_report and simulate: collect those of one command",
    }
    for name, said in refused.items():
        assert exit_code(monkeypatch, collect.main, str(folder / name)) == 2
        assert capsys.readouterr().err == f"error: {said}\n"
    assert exit_code(monkeypatch, collect.main) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not list(folder.rglob("sweep.*"))


def test_a_sweep_of_peers_has_each_variants_score_in_each_task(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = ["tasks=[recall]", "variants=[memory,lstm]", "seeds=2", "recall.iterations=3"]
    small += ["recall.batch=4", "tested=20", "workers=1"]
    small += ["output.figures=false", "output.tensorboard=false", f"run_dir={folder}"]
    assert exit_code(monkeypatch, peers.main, "-m", "recall.n_pairs=2,3", *small) == 0
    rows = table(folder)
    assert [row["recall.n_pairs"] for row in rows] == ["2", "3"]
    assert all(0 <= float(row["score_recall_memory"]) <= 1 for row in rows)
    assert all(float(row["score_recall_lstm_half"]) >= 0 for row in rows)


@pytest.mark.parametrize("launcher", ["joblib", "submitit_local", "ray"])
def test_the_table_is_the_same_under_every_launcher(launcher: str, folder: Path) -> None:
    if not launchers.is_installed(launcher):
        pytest.skip(f"{launcher} is not installed")
    for name in ("basic", launcher):
        chosen = [f"hydra/launcher={name}", f"run_dir={folder / name}"]
        command = [sys.executable, "-m", "experiments.simulate", *SWEPT, *chosen]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    tables = [(folder / name / "sweep.csv").read_bytes() for name in ("basic", launcher)]
    assert tables[0] == tables[1]


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["basic", "joblib", "submitit_local", "ray"])
def test_killed_half_way_and_repeated_the_remaining_jobs_run(launcher: str, folder: Path) -> None:
    if launcher != "basic" and not launchers.is_installed(launcher):
        pytest.skip(f"{launcher} is not installed")
    swept = ["-m", "scenario=1,2,4,5", "controller=nn,soft,hard", "constants.write_gain=0.5,0.75"]
    line = [sys.executable, "-m", "experiments.simulate", *swept, *SHORT]
    line.append(f"hydra/launcher={launcher}")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    whole = subprocess.run([*line, f"run_dir={folder / 'whole'}"], env=environment)
    assert whole.returncode == 0
    killed = folder / "killed"
    process = subprocess.Popen(
        [*line, f"run_dir={killed}"], env=environment, start_new_session=True
    )
    while len(list(killed.glob("*/metrics.json"))) < 10 and process.poll() is None:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    subprocess.run(["pkill", "-9", "-f", str(killed)])  # what a launcher has put elsewhere
    time.sleep(3)  # ray's daemons go by themselves
    done = {path: path.stat().st_mtime_ns for path in killed.glob("*/metrics.json")}
    assert 10 <= len(done) < 24 and not (killed / "sweep.csv").exists()
    again = subprocess.run([*line, f"run_dir={killed}"], env=environment)
    assert again.returncode == 0
    assert all(path.stat().st_mtime_ns == then for path, then in done.items())
    tables = [(f / "sweep.csv").read_bytes() for f in (folder / "whole", killed)]
    assert tables[0] == tables[1] and tables[0].count(b"ok") == 24
    print(f"{launcher}: killed with {len(done)} of 24 jobs done, {24 - len(done)} run again")


def test_a_launcher_that_is_not_there_is_refused_in_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(launchers, "is_installed", lambda name: False)
    refused = {
        "joblib": "hydra/launcher=joblib is not installed: pip install 'mann_torch[joblib]'",
        "slurm": "unknown hydra/launcher 'slurm'; choose from basic, joblib, submitit_local, "
        "submitit_slurm, ray",
    }
    for name, said in refused.items():
        arguments = [*SWEPT, f"hydra/launcher={name}", f"run_dir={folder}"]
        assert exit_code(monkeypatch, simulate.main, *arguments) == 2
        assert capsys.readouterr().err == f"error: {said}\n"
    assert not folder.exists()


def test_jobs_side_by_side_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launchers, "cores", lambda: 8)
    shares = {n: launchers.job_threads("joblib", SimpleNamespace(n_jobs=n)) for n in (1, 2, 3, -1)}
    assert shares == {1: 8, 2: 4, 3: 2, -1: 1}
    assert launchers.job_threads("joblib", SimpleNamespace(n_jobs=20)) == 1
    assert launchers.job_threads("submitit_slurm", OmegaConf.create({"cpus_per_task": 4})) == 4
    assert launchers.job_threads("submitit_local", OmegaConf.create({"cpus_per_task": None})) == 1
    assert launchers.job_threads("basic", None) is None


def some_run(value: float, named: tuple[str, ...] = (), **settings: Any) -> Run:
    plain = {key.replace("__", "."): each for key, each in settings.items()}
    found, units = {"srmse_q_1": Interval(value, 0.1)}, {"srmse_q_1": "rad"}
    return Run("0", plain, named, "ok", "simulate", found, units=units)


def test_what_follows_from_a_groups_name_is_a_column_only_if_it_was_asked_for() -> None:
    def two(*named: str) -> list[Run]:
        return [
            some_run(1.0, named, scenario__name="1", scenario__amplitude=[1], gain=1),
            some_run(2.0, named, scenario__name="2", scenario__amplitude=[2], gain=2),
        ]

    assert list(differing(two("scenario"))) == ["scenario"]
    assert list(differing(two("scenario", "gain"))) == ["scenario", "gain"]
    assert list(differing(two("scenario.amplitude"))) == ["scenario.amplitude", "scenario"]


def test_runs_by_different_engines_are_told_apart() -> None:
    runs = [some_run(1.0, engine=e, gain=g) for e, g in (("compiled", 1), ("eager", 2))]
    assert differing(runs) == {"gain": [1, 2], "engine": ["compiled", "eager"]}
    assert "engine" not in differing(runs[:1] * 2)


@pytest.mark.parametrize(
    ("settings", "axes"),
    [
        (lambda i: {"gain": i % 3}, 1),  # a line
        (lambda i: {"gain": i % 3, "rate": i // 3}, 2),  # a heat map and its scale
        (lambda i: {"gain": i % 3, "controller__name": "ab"[i // 3]}, 1),  # a line each
        (lambda i: {"gain": i % 3, "keys__name": "ab"[i // 3], "seed": i % 2}, 2),  # panels
    ],
)
def test_the_picture_follows_what_was_swept(
    settings: Callable[[int], dict[str, Any]], axes: int
) -> None:
    figure = picture([some_run(float(i), **settings(i)) for i in range(6)], "title")
    assert figure is not None and len(figure.axes) == axes


@pytest.mark.parametrize(
    ("settings", "joined"),
    [
        (lambda i: {"gain": i % 3, "controller__name": "ab"[i // 3]}, True),
        (lambda i: {"keys__name": "cd"[i % 2], "controller__name": "abc"[i // 2]}, False),
        (lambda i: {"scenario__name": str(i + 1)}, False),  # names, though they look like numbers
    ],
)
def test_a_line_joins_numbers_and_names_are_points(
    settings: Callable[[int], dict[str, Any]], joined: bool
) -> None:
    figure = picture([some_run(float(i), **settings(i)) for i in range(6)], "title")
    assert figure is not None
    (ax,) = figure.axes
    drawn = [container[0] for container in ax.containers]
    assert {line.get_linestyle() for line in drawn} == {"-" if joined else "None"}
    places = [tuple(x) for line in drawn for x in zip(*line.get_data(), strict=True)]
    assert len(places) == 6 and sorted(y for _, y in places) == [0, 1, 2, 3, 4, 5]
    if not joined:  # each of them by itself, nearest to its own name
        assert len({round(x, 6) for x, _ in places}) == 6
        names = [label.get_text() for label in ax.get_xticklabels()]
        assert {names[round(x)] for x, _ in places} == set(names)
    assert ax.get_ylabel() == "srmse_q_1 [rad]"


def test_metrics_of_outputs_have_their_units() -> None:
    outputs = [{"name": "q_1", "unit": "rad"}, {"name": "gain", "unit": ""}]
    assert units_of({"outputs": outputs}) == {"srmse_q_1": "rad", "srmse_after_10s_q_1": "rad"}
    assert units_of({}) == {}


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("python -m experiments.simulate scenario=1", "simulate"),
        ("python -m mann_torch.experiments.tune_problems", "tune_problems"),
        ("mann-gradient-report scenario=1", "gradient_report"),
        ("python -m experiments.nothing", ""),
        ("cp mann-simulate experiments", ""),
    ],
)
def test_a_record_names_its_command_however_it_was_called(command: str, name: str) -> None:
    assert command_of({"command": command}) == name
