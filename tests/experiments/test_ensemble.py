"""Thousands of rollouts as one command: chunks, workers, sums of several runs, the worst alone."""

import csv
import dataclasses
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from experiments import collect, ensemble, simulate
from experiments.building.build import build_scenario
from experiments.building.ensembles import composed
from experiments.building.plants import build_plant
from experiments.building.spreads import random_rows, spreads, with_rows
from experiments.ensembles.histogram import histogram
from experiments.ensembles.rollouts import Rollouts, joined, read_rollouts, text_of
from experiments.ensembles.summary import ranges, statistics, table, worst
from experiments.runs import workers
from experiments.sweeps import jobs
from mann_torch.errors import ConfigError
from tests.experiments.command import exit_code

ROOT = Path(__file__).parents[2]
ARM = [("q_1", "rad"), ("q_2", "rad")]
QUIET = ["output.figures=false", "output.tensorboard=false"]
SHORT = ["horizon=6", "rollouts=8", "chunk=3", "workers=1"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "run"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    return exit_code(monkeypatch, ensemble.main, *arguments)


def srmse_alone(monkeypatch: pytest.MonkeyPatch, folder: Path, place: Path) -> list[list[float]]:
    """What the command of the worst rollout's line comes to, beside its row in rollouts.csv."""
    page = (folder / "ensemble.md").read_text()
    command = shlex.split(page.split("To run one of them alone: `")[1].split("`")[0])
    line = page.split("| overrides")[1].splitlines()[2].split("|")
    own = shlex.split(line[4].strip(" `"))
    arguments = [*command[3:], *own, f"run_dir={place}", "output.figures=false"]
    assert command[:3] == ["python", "-m", "experiments.simulate"]
    assert exit_code(monkeypatch, simulate.main, *arguments, "output.tensorboard=false") == 0
    rows = list(csv.DictReader((folder / "rollouts.csv").read_text().splitlines()))
    row = next(row for row in rows if row["rollout"] == line[1].strip())
    (srmse,) = json.loads((place / "metrics.json").read_text())["srmse"]
    return [srmse, [float(row["srmse_q_1"]), float(row["srmse_q_2"])]]


def random_masses(spread: float, seed: int, first: int, count: int) -> torch.Tensor:
    rows = {"masses": torch.tensor([0.8, 2.3], dtype=torch.float64)}
    return random_rows(rows, {"masses": spread}, seed, first, count)["masses"]


def test_masses_depend_on_seed_and_number_alone() -> None:
    masses = random_masses(0.3, 5, 0, 2000)
    assert torch.equal(masses[700:710], random_masses(0.3, 5, 700, 10))
    factors = masses / torch.tensor([0.8, 2.3])
    assert 0.7 <= factors.min() < 0.71 and 1.29 < factors.max() <= 1.3
    assert (factors.mean(dim=0) - 1).abs().max() < 4 * 0.3 / (3 * 2000) ** 0.5
    assert abs(torch.corrcoef(factors.T)[0, 1]) < 0.1
    assert not torch.equal(masses, random_masses(0.3, 6, 0, 2000))
    assert random_masses(0.0, 5, 9, 2).tolist() == [[0.8, 2.3]] * 2
    # As it was when masses alone could be spread: ensembles of old go on with the same numbers.
    old = [[0.9121980586134255, 2.4249184895103384], [0.6795194395787137, 2.5450751795787894]]
    assert masses[:2].tolist() == old


def test_every_parameter_has_numbers_of_its_own() -> None:
    plant, parameters = build_plant({"name": "n_link_arm", "n_joints": 3, "viscous": 0.5})
    rows = parameters._asdict()
    spread = spreads({"viscous": 0.1, "masses": 0.2, "lengths": None}, plant)
    assert list(spread) == ["masses", "viscous"]  # in the plant's order, whatever is said first
    found = random_rows(rows, spread, 5, 0, 500)
    later = random_rows(rows, spread, 5, 300, 10)
    factors = torch.cat([found[name] / rows[name] for name in spread], dim=-1)
    assert factors.shape == (500, 6) and len(set(factors.flatten().tolist())) == 3000
    assert (torch.corrcoef(factors.T) - torch.eye(6)).abs().max() < 0.2
    assert all(torch.equal(found[name][300:310], later[name]) for name in spread)
    assert 0.89 < factors[:, 3:].min() < 0.91 and 0.79 < factors[:, :3].min() < 0.81


@pytest.mark.parametrize("scenario", ["1", "3"])
def test_masses_jump_and_grow_as_those_of_one_rollout(scenario: str) -> None:
    cfg = composed((f"scenario='{scenario}'",))
    plant, parameters = build_plant(cfg.plant)
    masses = random_masses(0.2, 0, 0, 3)
    scene = build_scenario(cfg, plant, parameters)
    many = with_rows(scene, cfg.scenario, plant, {"masses": masses})
    t = torch.tensor([0.0, 5.0, 77.0, 300.0])
    for row, own in enumerate(masses.tolist()):
        alone = build_scenario(cfg, *build_plant({**cfg.plant, "masses": own}))
        assert torch.equal(many.parameters_at(t).masses[:, row], alone.parameters_at(t).masses)
        assert torch.equal(many.parameters.masses[row], alone.parameters.masses)


def test_a_run_leaves_rollouts_a_page_a_picture_and_curves(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, *SHORT, "controller=hard", f"run_dir={folder}") == 0
    found = read_rollouts(folder, ARM)
    assert found.number.tolist() == list(range(8)) and found.ok.all()
    assert len({tuple(m) for m in found.drawn.tolist()}) == 8
    record = json.loads((folder / "metrics.json").read_text())
    assert record["measures"]["srmse_q_1"]["mean"] == pytest.approx(found.srmse[:, 0].mean())
    assert record["rollouts"] == 8 and record["diverged"] == 0 and record["peak_mb"] < 2000
    page = (folder / "ensemble.md").read_text()
    assert "`python -m experiments.ensemble horizon=6 " in page and "8 rollouts, 0 to 7" in page
    assert "`python -m experiments.simulate horizon=6 controller=hard`" in page
    assert (folder / "histogram.png").read_bytes().startswith(b"\x89PNG")
    (log,) = {path.parent for path in folder.rglob("events.out*")}
    curves = EventAccumulator(str(log)).Reload().Tags()
    assert "srmse_q_1" in curves["histograms"] and "metrics/srmse_q_1" in curves["scalars"]
    alone, here = srmse_alone(monkeypatch, folder, folder.parent / "alone")
    assert alone == here
    assert "8 rollouts" in capsys.readouterr().out


@pytest.mark.slow
def test_the_worst_alone_is_the_same_over_the_full_horizon(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "rollouts=40", "chunk=25", "seed=3", *QUIET, f"run_dir={folder}") == 0
    alone, here = srmse_alone(monkeypatch, folder, folder.parent / "alone")
    assert alone == here


@pytest.mark.slow
def test_neither_chunks_nor_portions_change_a_rollout(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = [*SHORT[:2], *QUIET, "initial.draw=2"]
    assert run(monkeypatch, *one, "chunk=8", f"run_dir={folder / 'one'}") == 0
    whole = (folder / "one" / "rollouts.csv").read_bytes()
    portions = ["-m", "first=0,5", "rollouts=5", "chunk=4", "workers=1", "initial.draw=2"]
    arguments = [*portions, SHORT[0], *QUIET, f"run_dir={folder / 'sum'}"]
    assert run(monkeypatch, *arguments) == 0
    lines = (folder / "sum" / "rollouts.csv").read_text().splitlines()
    assert lines[:9] == whole.decode().splitlines() and len(lines) == 11
    page = (folder / "sum" / "ensemble.md").read_text()
    assert "10 rollouts, 0 to 9" in page and "initial.draw=2 " not in page.split("`")[3]
    assert (folder / "sum" / "histogram.png").exists()
    table = list(csv.DictReader((folder / "sum" / "sweep.csv").read_text().splitlines()))
    assert [row["first"] for row in table] == ["0", "5"] and float(table[0]["srmse_q_1_q99"]) > 0
    # Portions that overlap count once; other settings are another ensemble.
    folders = [str(folder / name) for name in ("one", "sum")]
    for out, given in (("all", folders), ("again", folders[::-1])):
        arguments = [*given, "--out", str(folder / out)]
        assert exit_code(monkeypatch, collect.main, *arguments) == 0
        assert (folder / out / "rollouts.csv").read_text().splitlines() == lines
    other = [*one, "spread.masses=0.1", f"run_dir={folder / 'other'}"]
    assert run(monkeypatch, *other) == 0
    folders.append(str(folder / "other"))
    assert exit_code(monkeypatch, collect.main, *folders, "--out", str(folder / "both")) == 0
    rows = list(csv.DictReader((folder / "both" / "rollouts.csv").read_text().splitlines()))
    names = [row["ensemble"] for row in rows]
    assert names == ["spread.masses 0.2"] * 10 + ["spread.masses 0.1"] * 8
    assert "## spread.masses 0.1" in (folder / "both" / "ensemble.md").read_text()


@pytest.mark.slow
def test_finished_chunks_are_not_computed_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*SHORT, *QUIET, f"run_dir={folder}"]
    assert run(monkeypatch, *arguments) == 0
    whole = (folder / "rollouts.csv").read_bytes()
    (folder / "metrics.json").unlink()
    (folder / "rollouts.csv").unlink()
    (folder / "finished" / "3_3.npz").write_bytes(b"half a file")
    capsys.readouterr()
    assert run(monkeypatch, *arguments) == 0
    assert "2 of 3 parts were finished before" in capsys.readouterr().out
    assert (folder / "rollouts.csv").read_bytes() == whole


@pytest.mark.slow
def test_killed_half_way_with_more_workers_it_goes_on_to_the_same_rollouts(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["rollouts=60", "chunk=5", "workers=2", *QUIET]
    whole = [a for a in arguments if a != "workers=2"]
    assert run(monkeypatch, *whole, "workers=1", f"run_dir={folder / 'whole'}") == 0
    killed = folder / "killed"
    command = [sys.executable, "-m", "experiments.ensemble", *arguments, f"run_dir={killed}"]
    process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT)})
    deadline = time.monotonic() + 120
    while len(list(killed.glob("finished/*.npz"))) < 5 and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (killed / "metrics.json").exists()
    assert run(monkeypatch, *arguments, f"run_dir={killed}") == 0
    files = [(place / "rollouts.csv").read_bytes() for place in (folder / "whole", killed)]
    assert files[0] == files[1]


def made_up(
    numbers: list[int], seed: int = 0, outputs: Sequence[tuple[str, str]] = ARM
) -> Rollouts:
    draw, n = np.random.default_rng(seed), len(numbers)
    errors = draw.uniform(1e-3, 9e-3, (2, n, len(outputs)))
    status = np.array(["ok"] * n, dtype=object)
    status[1] = "diverged at t = 3 s: W too large"
    errors[:, 1] = np.nan
    counts = draw.integers(0, 9, (2, n))
    entries, drawn = np.array(["masses_1", "masses_2"]), draw.uniform(1, 2, (n, 2))
    first = np.array(outputs), entries, np.array(numbers), drawn
    return Rollouts(*first, *errors, *counts, status)


def test_what_diverged_is_told_and_counts_in_no_mean(tmp_path: Path) -> None:
    found = made_up([3, 4, 5, 7, 8])
    (tmp_path / "rollouts.csv").write_text(text_of({"": found}))
    again = read_rollouts(tmp_path, ARM)
    for field in dataclasses.fields(Rollouts):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(found, field.name))
    assert ranges(found.number) == "3 to 5, 7 to 8"
    assert statistics(found)["srmse_q_1"]["mean"] == pytest.approx(np.nanmean(found.srmse[:, 0]))
    assert worst(found)[0] == 1 and len(worst(found)) == 5
    both = joined([made_up([8, 9], 1), found])
    assert both.number.tolist() == [3, 4, 5, 7, 8, 9]
    figure = histogram({"a": found, "b": both}, "title")
    assert len(figure.axes) == 4 and all(ax.get_legend() for ax in figure.axes)


def test_any_number_of_outputs_goes_by_name_in_columns_tables_and_pictures(tmp_path: Path) -> None:
    flight = [("x", "m"), ("y", "m"), ("pitch", "rad")]
    found, lone = made_up([0, 1, 2], outputs=flight), made_up([0, 1], outputs=[("y", "m")])
    header, *rows = csv.reader(text_of({"": found}).splitlines())
    assert header[3:9] == [
        *(f"{key}_{name}" for key in ("srmse", "srmse_after_10s") for name, _ in flight)
    ]
    assert float(rows[2][header.index("srmse_pitch")]) == found.srmse[2, 2]
    assert "| srmse_pitch x 10^3 [rad] " in table(found) and "| srmse_y x 10^3 [m] " in table(lone)
    for rollouts, outputs in ((found, flight), (lone, [("y", "m")])):
        (tmp_path / "rollouts.csv").write_text(text_of({"": rollouts}))
        np.testing.assert_array_equal(read_rollouts(tmp_path, outputs).srmse, rollouts.srmse)
    with pytest.raises(ConfigError, match="no rollouts can be read"):
        read_rollouts(tmp_path, flight)
    # Two plants in one table: what one has no number of is empty.
    both = list(csv.DictReader(text_of({"a": found, "b": lone}).splitlines()))
    assert [row["ensemble"] for row in both] == ["a"] * 3 + ["b"] * 2
    assert both[3]["srmse_x"] == "" and float(both[3]["srmse_y"]) == lone.srmse[0, 0]
    labels = [ax.get_xlabel() for ax in histogram({"a": found, "b": lone}, "").axes[3:]]
    assert [label[-3:] for label in labels] == ["[m]", "[m]", "ad]"] and "pitch" in labels[2]


@pytest.mark.slow
def test_workers_are_as_many_as_a_launcher_leaves_cores(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr(jobs, "job_threads", lambda name, settings: 1)
    monkeypatch.setattr(workers, "ProcessPoolExecutor", None)  # a second process would be an error
    arguments = ["-m", "seed=0,1", *SHORT[:3], "workers=2", *QUIET, f"run_dir={folder}"]
    assert run(monkeypatch, *arguments) == 0


BAD = {
    "rollouts=0": "rollouts = 0: must be 1 to 1048576",
    "first=-1": "first = -1",
    "chunk=0": "chunk = 0",
    "workers=0": "workers = 0",
    "spread.masses=1": "spread.masses = 1: must be >= 0 and < 1",
    "spread.masses=nan": "spread.masses",
    "first=1048570": "draws must be >= 0 and < 1048576",
    "initial.draw=-1": "draws must be >= 0 and < 1048576",
    "initial.weights_file=nowhere.npz": "does not exist",
    "seed=-1": "seed = -1",
    "horizon=0": "horizon = 0",
    "plant.masses=[1]": "plant.masses",
    "draws=3": "unknown setting 'draws'",
    "+spread.m=3": "unknown setting 'spread.m'",
    "controller=magic": "unknown controller",
}


@pytest.mark.parametrize("setting", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(
    setting: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = [s for s in SHORT if s.split("=")[0] != setting.split("=")[0]]
    assert run(monkeypatch, *given, setting, f"run_dir={folder}") == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and said.count("\n") == 1 and BAD[setting] in said
    assert not folder.exists()
