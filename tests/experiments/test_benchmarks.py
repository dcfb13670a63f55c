"""Problems with known answers as a command: what is known beside ours, and what off means."""

import csv
import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from experiments import benchmarks, simulate, tune
from experiments.building.build import build
from experiments.building.ensembles import composed
from experiments.command.cli import compose_job
from experiments.command.conf_files import CONF, group_names
from experiments.problems.every import PROBLEMS
from experiments.problems.known import at_least, at_most, closed, printed, single
from experiments.problems.measures import crossing, peak, simpson
from experiments.settings.benchmarks_config import BENCHMARKS
from experiments.sweeps import measures
from tests.experiments.command import exit_code

QUIET = ["output.figures=false", "output.tensorboard=false"]
#: Problems of which no constant can be tuned.
NOTHING_TO_TUNE = {"wing_rock_open"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "run"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    return exit_code(monkeypatch, benchmarks.main, *arguments)


def test_a_problem_is_run_judged_and_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["problems=[scalar_mrac]", "workers=1", f"run_dir={folder}"]
    assert run(monkeypatch, *asked) == 0
    record = json.loads((folder / "metrics.json").read_text())
    rows = list(csv.DictReader((folder / "table.csv").read_text().splitlines()))
    assert len(record["rows"]) == len(rows) == 10
    assert {row["verdict"] for row in rows} == {"agrees"}
    gains = {(row["case"], row["quantity"]): row for row in record["rows"]}
    assert gains["gamma = 1", "k_r(100 s)"]["ours"] == pytest.approx(3.19081058, abs=6e-9)
    assert 0 < gains["gamma = 1", "k_r(100 s)"]["spread"] < 1e-9
    report = (folder / "report.md").read_text()
    assert "10 of 10 numbers agree" in report and record["command"] in report
    assert "![scalar_mrac](figures/scalar_mrac.png)" in report
    assert (folder / "figures/scalar_mrac.png").stat().st_size > 10_000
    arrays = np.load(folder / "arrays/scalar_mrac-fast.npz")
    assert arrays["W"][-1, 1, 0] == gains["gamma = 1", "k_r(100 s)"]["ours"]
    assert measures.measured(record)[0]["off"].mean == 0

    # A run that was stopped takes what is finished; what is finished is not run again.
    (folder / "metrics.json").unlink()
    monkeypatch.setattr(benchmarks, "run_case", None)
    assert run(monkeypatch, *asked) == 0
    again = json.loads((folder / "metrics.json").read_text())
    assert again["rows"] == record["rows"]


def test_a_wrong_constant_is_off(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = 'overrides=["law.constant.adaptation_rate=0.201","horizon=20"]'
    asked = ["problems=[scalar_mrac]", wrong, "halved=false", "workers=1", *QUIET]
    assert run(monkeypatch, *asked, f"run_dir={folder}") == 1
    assert "numbers are off" in capsys.readouterr().err
    rows = json.loads((folder / "metrics.json").read_text())["rows"]
    off = {row["quantity"]: row["verdict"] for row in rows if row["case"] == "gamma = 0.2"}
    assert off["k_r(20 s)"] == "off" and off["k_x(20 s)"] == "off"
    assert all(row["spread"] is None for row in rows)


@pytest.mark.parametrize(
    ("argument", "says"),
    [
        ("problems=[rohr]", "unknown problem 'rohr'"),
        ("problems=[]", "at least one"),
        ("engine=slow", "engine = slow"),
        ("workers=0", "workers = 0"),
        ('overrides=["law.constant.rate=1"]', "law.constant.rate"),
        ("+steps=3", "steps"),
    ],
)
def test_what_cannot_be_used_is_one_line(
    argument: str,
    says: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = (
        [argument] if argument.startswith("problems") else ["problems=[limited_input]", argument]
    )
    assert run(monkeypatch, *asked, f"run_dir={folder}") == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1
    assert not folder.exists()


def test_digits_say_how_far_ours_may_be_off() -> None:
    assert printed("", "-12.6394", None).agrees(-12.63936)
    assert not printed("", "-12.6394", None).agrees(-12.63930)
    assert printed("", "2.03e-6", None).agrees(2.034e-6)
    assert not printed("", "2.03e-6", None).agrees(2.036e-6)
    assert printed("", "10", None).agrees(10.4) and not printed("", "10", None).agrees(10.6)
    nothing = lambda run: 0.0  # noqa: E731
    assert closed("", 2.0, nothing).agrees(2.0 + 1.9e-6)
    assert not closed("", 2.0, nothing).agrees(2.0 + 2.1e-6)
    assert not closed("", 0.0, nothing, floor=1e-8).agrees(1.1e-8)
    assert single("", "0.9121", None).agrees(0.91218) and not single("", "0.9121", None).agrees(
        0.913
    )
    assert at_most("", 1.0, nothing).agrees(1.0) and not at_most("", 1.0, nothing).agrees(1.1)
    assert at_least("", 1.0, nothing).agrees(1.0) and not at_least("", 1.0, nothing).agrees(0.9)
    assert not at_most("", 1.0, nothing).agrees(float("nan"))


def test_measures_find_peaks_crossings_and_integrals() -> None:
    t = np.linspace(0.0, 2.0, 41)
    assert peak(1.0 - (t - 0.983) ** 2) == pytest.approx(1.0, abs=1e-14)
    assert crossing(t, 3.0 * t - 1.0) == pytest.approx(1 / 3, abs=1e-14)
    assert np.isnan(crossing(t, t - 5.0))
    assert simpson(t, t**3) == pytest.approx(4.0, rel=1e-14)


def test_every_problem_is_a_setting_that_builds() -> None:
    """And says where its numbers come from, and what of it is tuned."""
    for name in group_names("problem"):
        cfg = composed((f"problem={name}",))
        made = build(cfg)
        assert cfg.problem.name == name
        assert set(cfg.problem.names) <= set(made.loop.constants()), name
        assert (CONF / f"problem/{name}.yaml").read_text().splitlines()[1].startswith("# ")


def test_cases_are_of_problems_there_are_and_use_all_of_them() -> None:
    assert tuple(PROBLEMS) == BENCHMARKS
    used = {
        overrides[0].removeprefix("problem=")
        for problem in PROBLEMS.values()
        for case in problem.cases.values()
        for overrides in (case.overrides, *case.others)
    }
    assert used == set(group_names("problem"))


def test_the_command_line_comes_after_a_problem() -> None:
    given = ("problem=rohrs_sigma", "law.sigma.sigma=0.3", "plant.fast_poles=false", "horizon=3")
    cfg = composed(given)
    assert cfg.law["sigma"]["sigma"] == 0.3 and cfg.plant["fast_poles"] is False
    assert cfg.horizon == 3 and build(cfg).scenario.end == 3.0
    assert composed(("problem=rohrs", "solver=implicit")).solver.name == "implicit"


@pytest.mark.parametrize("command", ["ensemble", "gradient_report", "tune"])
@pytest.mark.parametrize("name", ["rohrs_projection", "quadrotor_learned"])
def test_studies_accept_a_problem(command: str, name: str) -> None:
    module = importlib.import_module(f"experiments.{command}")
    module.checked(compose_job(command, [f"problem={name}"]))


@pytest.mark.slow
@pytest.mark.parametrize("command", ["ensemble", "gradient_report", "simulate", "tune"])
def test_studies_accept_every_problem(command: str) -> None:
    module = importlib.import_module(f"experiments.{command}")
    for name in group_names("problem"):
        if name not in NOTHING_TO_TUNE or command in ("simulate", "ensemble"):
            module.checked(compose_job(command, [f"problem={name}"]))


def test_a_problem_is_tuned_on_its_own_scenario(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ["problem=scalar_mrac", "horizon=12", "schedule.iterations=1", "train.draws=[0]"]
    asked += ["held_out.draws=[0]", "gradient.mode=plain", *QUIET, f"run_dir={folder}"]
    assert exit_code(monkeypatch, tune.main, *asked) == 0
    record = json.loads((folder / "metrics.json").read_text())
    assert list(record["constants"]) == ["adaptation_rate"]
    assert [verdict["scenario"] for verdict in record["held_out"]] == ["scalar_mrac"]


@pytest.mark.slow
def test_all_numbers_agree(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, f"run_dir={folder}", *QUIET) == 0
    record = json.loads((folder / "metrics.json").read_text())
    assert {row["problem"] for row in record["rows"]} == set(BENCHMARKS)
    assert len(record["rows"]) > 100


@pytest.mark.slow
def test_the_torch_engine_agrees_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["problems=[estimators]", "engine=torch", "halved=false", f"run_dir={folder}", *QUIET]
    assert run(monkeypatch, *asked) == 0
    record = json.loads((folder / "metrics.json").read_text())
    assert record["engines"] == "eager"


@pytest.mark.slow
def test_a_sweep_over_problems_is_one_table(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["-m", "problem=scalar_mrac,limited_input", "horizon=5", f"run_dir={folder}", *QUIET]
    assert exit_code(monkeypatch, simulate.main, *asked) == 0
    page = (folder / "sweep.md").read_text()
    assert "scalar_mrac" in page and "limited_input" in page and "failed" not in page
