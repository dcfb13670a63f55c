"""The simulate command line, in this process."""

import importlib
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from experiments import simulate
from experiments.command import cli
from experiments.command.conf_files import CONF, group_names
from experiments.command.help_texts import HELP
from experiments.command.overrides import jobs_of, quote_numeric_names
from experiments.runs.memory_figures import attention_timeline
from tests.conftest import GOLDEN
from tests.experiments.command import exit_code

ROOT = Path(__file__).parents[2]
PICTURES = {"outputs", "inputs", "states", "features_and_read", "attention", "memory"}
WEIGHTS = f"initial.weights_file={GOLDEN / 'initial_weights.npz'}"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    return exit_code(monkeypatch, simulate.main, *arguments)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "run"


def test_a_run_leaves_everything_behind(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["scenario=5", "controller=reallocating_initial", "keys=representation"]
    arguments += ["solver=implicit", "solver.dt=0.005", "horizon=1", "seed=0", "draws=2"]
    assert run(monkeypatch, *arguments, f"run_dir={folder}") == 0
    metrics = json.loads((folder / "metrics.json").read_text())
    assert np.array(metrics["srmse"]).shape == (2, 2)
    assert metrics["srmse_after_10s"] == [[None, None], [None, None]]  # nothing after 10 s
    assert metrics["status"] == ["ok", "ok"] and len(metrics["switches"]) == 2
    assert metrics["wall_s"] > 0 and " scenario=5 " in metrics["command"]
    cfg = OmegaConf.load(folder / "config.yaml")
    assert cfg.plant.lengths == [1.0, 2.0] and cfg.scenario.name == "5" and cfg.draws == 2
    with np.load(folder / "trajectory.npz") as arrays:
        assert arrays["t"][0] == 0.0 and arrays["t"][-1] == 1.0
        assert arrays["q"].shape == (21, 2, 2) and arrays["mu"].shape == (21, 2, 5, 10)
        error = arrays["reference"] - arrays["q"]
        np.testing.assert_allclose(arrays["error"], error, atol=1e-14)
    pngs = {path.name for path in folder.glob("*.png")}
    assert pngs == {f"{name}.png" for name in PICTURES}
    assert not list(folder.rglob(".*.png.*"))


def test_tensorboard_holds_curves_figures_and_settings_in_one_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "controller=hard", "horizon=0.5", f"run_dir={folder}") == 0
    named = folder / "controller=hard,horizon=0.5"  # by what was asked for, none by the time
    events = list(folder.rglob("events.out.tfevents.*"))
    assert [path.parent for path in events] == [named]
    accumulator = EventAccumulator(str(named), size_guidance={"scalars": 0}).Reload()
    tags = accumulator.Tags()
    assert {"draw0/error_q_1", "draw0/torque_2", "draw0/attended"} <= set(tags["scalars"])
    assert len(accumulator.Scalars("draw0/error_q_1")) == 11
    assert set(tags["images"]) == PICTURES
    assert "_hparams_/session_start_info" in accumulator.summary_metadata
    results = json.loads((folder / "metrics.json").read_text())["srmse"][0]
    assert accumulator.Scalars("metrics/srmse_q_1")[0].value == pytest.approx(results[0], rel=1e-6)


def hparams_of(folder: Path) -> set[str]:
    """Settings in TensorBoard's table."""
    accumulator = EventAccumulator(str(folder)).Reload()
    content = accumulator.summary_metadata["_hparams_/session_start_info"].plugin_data.content
    return set(HParamsPluginData.FromString(content).session_start_info.hparams)


@pytest.mark.slow
def test_tensorboards_table_holds_what_differs(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["-m", "seed=0,3", "solver.dt=0.002", "horizon=0.05", "output.figures=false"]
    assert run(monkeypatch, *arguments, f"run_dir={folder}") == 0
    identity = {"scenario/name", "controller/name", "keys/name"}
    for number, seed in enumerate((0, 3)):
        named = folder / str(number) / f"seed={seed},solver.dt=0.002,horizon=0.05"
        assert hparams_of(named) == identity | {"seed", "solver/dt", "horizon"}


@pytest.mark.slow
def test_tensorboard_shows_soft_attention_as_weights(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quiet = ["controller=soft", "horizon=0.1", "output.figures=false"]
    assert run(monkeypatch, *quiet, f"run_dir={folder}") == 0
    (events,) = folder.rglob("events.out.tfevents.*")
    tags = set(EventAccumulator(str(events.parent)).Reload().Tags()["scalars"])
    assert {"draw0/weight_1", "draw0/weight_5"} <= tags and "draw0/attended" not in tags


def test_soft_attention_is_drawn_as_weights() -> None:
    t = np.arange(3.0)
    soft = np.tile([0.5, 0.3, 0.2], (3, 1))
    run = {"t": t, "weights": soft, "attended": np.zeros(3), "masses": np.ones((3, 2))}
    run |= {"reallocations": np.zeros(3), "parameters": np.array([["masses", "kg"]])}
    hard = {**run, "weights": np.tile([1.0, 0.0, 0.0], (3, 1))}
    top, middle, _ = attention_timeline({"soft": run, "hard": hard}, "").axes
    assert "weights" in top.get_title() and top.get_ylim() == (0.0, 1.0)
    assert len(top.collections) == 3 and top.get_legend() is not None
    assert "attended slot" in middle.get_title()


@pytest.mark.slow
def test_weights_file_gives_the_files_draw(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    common = [WEIGHTS, "controller=nn", "horizon=0.3", "output.figures=false"]
    assert run(monkeypatch, *common, "draws=3", f"run_dir={folder}/all") == 0
    assert run(monkeypatch, *common, "initial.draw=2", f"run_dir={folder}/one") == 0
    every, one = (json.loads((folder / d / "metrics.json").read_text()) for d in ("all", "one"))
    assert every["srmse"][2] == pytest.approx(one["srmse"][0], rel=1e-10)
    assert every["srmse"][0] != every["srmse"][1]


@pytest.mark.slow
def test_multirun_runs_the_product(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["-m", "scenario=1,4_offset", "controller=nn,hard", "horizon=0.05"]
    assert run(monkeypatch, *arguments, "output.tensorboard=false", f"run_dir={folder}") == 0
    found = [json.loads(p.read_text()) for p in sorted(folder.glob("*/metrics.json"))]
    pairs = {(m["scenario"], m["controller"]) for m in found}
    assert pairs == {(s, c) for s in ("1", "4_offset") for c in ("nn", "hard")}


@pytest.mark.parametrize("scenario", group_names("scenario"))
@pytest.mark.parametrize("controller", ["nn", "reallocating_always"])
def test_every_scenario_and_key_rule_builds_and_steps(
    scenario: str, controller: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [f"scenario={scenario}", f"controller={controller}", "horizon=0.02"]
    arguments += ["keys=state"] if controller != "nn" else []  # which has no memory
    quiet = ["output.figures=false", "output.tensorboard=false", f"run_dir={folder}"]
    assert run(monkeypatch, *arguments, *quiet) == 0


BAD = [
    ("scenario=7", "unknown scenario '7'; choose from 1, 1_long_arm, 2"),
    ("controller=lstm", "choose from computed_torque, estimator, hard, l1, linear_feedback"),
    ("keys=foo", "unknown keys 'foo'; choose from representation, state"),
    ("solver=rk5", "unknown solver 'rk5'"),
    ("plant.masses=[-0.8,2.3]", "masses"),
    ("plant.masses=[nan,2.3]", "plant.masses"),
    ("plant.masses=[0.8]", "plant.masses"),
    ("plant.masses=[0.8,2.3,1]", "plant.masses"),
    ("plant.lengths=[0,1]", "lengths"),
    ("solver.dt=0", "dt"),
    ("solver.dt=-0.005", "dt"),
    ("solver.dt=nan", "dt"),
    ("controller.n_hidden=0", "n_hidden"),
    ("memory.n_slots=0", "n_slots"),
    ("memory.reset=zero", "reset"),
    ("constants.shift_threshold=-0.1", "shift_threshold"),
    ("constants.error_gain=[1,2,3]", "error_gain"),
    ("constants.error_gain=[[1,2],[2,1]]", "error_gain"),
    ("constants.error_gain=fast", "error_gain"),
    ("scenario.reference.amplitude=[1,0,0]", "scenario.reference"),
    ("scenario.schedule.masses=[[5]]", "schedule.masses"),
    ("scenario.schedule.masses=[[5,-1]]", "schedule.masses"),
    ("scenario.schedule.masses=[[5,sqrt(x)]]", "schedule.masses"),
    ("scenario.schedule.masses=[7]", "schedule.masses"),
    ("scenario.schedule.masses=[[9,2],[5,2]]", "increase"),
    ("horizon=0", "horizon"),
    ("horizon=inf", "horizon"),
    ("draws=0", "draws"),
    ("draws=two", "draws"),
    ("seed=-1", "seed"),
    ("initial.std=-1", "initial.std"),
    ("initial.draw=-1", "initial.draw"),
    ("output.sample_dt=0", "sample_dt"),
    ("output.member=-1", "output.member"),
    ("draws=2 output.member=2", "output.member"),
    ("output.format=gif", "output.format: no 'gif'; choose from png, pdf, svg"),
    ("output.format=[]", "output.format"),
    ("output.dpi=0", "output.dpi"),
    ("speed=3", "speed"),
    ("+speed=3", "unknown setting 'speed'"),
    ("+plant.colour=red", "unknown setting 'plant.colour'"),
    ("scenario=1,2", "scenario"),
    ("horizon", "horizon"),
    ("initial.weights_file=/nowhere.npz", "/nowhere.npz"),
    # settings the chosen controller does not use are checked all the same
    ("controller=soft constants.shift_threshold=-0.1", "shift_threshold"),
    ("controller=nn constants.write_gain=nan", "write_gain"),
    ("controller=nn memory.n_slots=-3", "n_slots"),
    ("controller=nn keys.name=foo", "unknown keys 'foo'"),
    ("controller=hard controller.phase=foo", "phase"),
    ("constants.key_rate=-1", "key_rate"),
    ("solver.rtol=nan", "rtol"),
    # slips of the pen
    ("seed=99999999999999999", "seed"),
    ("solver.dt=1e-300", "steps"),
    ("output.sample_dt=1e-300", "samples"),
    ("horizon=1e300", "samples"),
    ("scenario=3 scenario.schedule.masses=[{every:1e-9,growth:0.2}]", "every"),
    ("scenario.schedule.masses=[{a:1,b:2}]", "schedule.masses"),
    ("seed=${nope}", "nope"),
    ("~plant", "plant has no name; choose plant=two_link_arm"),
    ("hydra.foo=1", "foo"),
    ("-m run_dir=A,B", "run_dir"),
]


@pytest.mark.parametrize(("argument", "words"), BAD)
def test_bad_input_is_one_line_exit_code_2_and_no_folder(
    argument: str,
    words: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    where = [] if "run_dir" in argument else [f"run_dir={folder}"]
    assert run(monkeypatch, *argument.split(), *where) == 2
    out, err = capsys.readouterr()
    assert out == "" and len(err.strip().splitlines()) == 1 and words in err
    assert list(folder.parent.iterdir()) == []


def damaged(path: Path, kind: str) -> Path:
    whole = (GOLDEN / "initial_weights.npz").read_bytes()
    with np.load(GOLDEN / "initial_weights.npz") as data:
        arrays = {name: data[name] for name in data.files}
    if kind == "truncated":
        path.write_bytes(whole[: len(whole) // 2])
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "text":
        path.write_text("not an archive")
    elif kind == "flipped":
        path.write_bytes(whole[:400] + bytes([whole[400] ^ 0xFF]) + whole[401:])
    elif kind == "pickle":
        np.savez(path, V_10=np.array([{}], dtype=object), b_v_10=np.zeros((1, 10)))
    elif kind == "strings":
        np.savez(path, V_10=np.array([["a"]]), b_v_10=np.zeros((1, 10)))
    elif kind == "missing V_10":
        np.savez(path, V_14=arrays["V_14"], b_v_14=arrays["b_v_14"])
    elif kind == "wrong shape":
        np.savez(path, V_10=arrays["V_10"][:, :9], b_v_10=arrays["b_v_10"])
    elif kind == "wrong bias":
        np.savez(path, V_10=arrays["V_10"], b_v_10=arrays["b_v_10"][:5])
    elif kind == "nan":
        np.savez(path, V_10=arrays["V_10"] * np.nan, b_v_10=arrays["b_v_10"])
    return path


@pytest.mark.parametrize(
    "kind",
    [
        "truncated",
        "empty",
        "text",
        "flipped",
        "pickle",
        "strings",
        "missing V_10",
        "wrong shape",
        "wrong bias",
        "nan",
    ],
)
def test_a_bad_weights_file_is_one_line_and_exit_code_2(
    kind: str,
    tmp_path_factory: pytest.TempPathFactory,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = damaged(tmp_path_factory.mktemp("weights") / "w.npz", kind)
    assert run(monkeypatch, f"initial.weights_file={path}", f"run_dir={folder}") == 2
    err = capsys.readouterr().err
    assert len(err.strip().splitlines()) == 1 and "weights file" in err
    assert not folder.exists()


def test_a_draw_out_of_range_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, WEIGHTS, "initial.draw=10", f"run_dir={folder}") == 2
    assert "draws 0 to 9" in capsys.readouterr().err and not folder.exists()


def test_a_weights_file_may_number_its_draws(
    folder: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with np.load(GOLDEN / "initial_weights.npz") as data:
        arrays = {name: data[name][[2, 5, 4]] for name in data.files}
    path = tmp_path_factory.mktemp("weights") / "some.npz"
    np.savez(path, draws=np.array([2, 5, 4]), **arrays)
    quiet = ["controller=nn", "horizon=0.3", "output.figures=false", "initial.draw=4", "draws=2"]
    assert run(monkeypatch, *quiet, WEIGHTS, f"run_dir={folder}/all") == 0
    assert run(monkeypatch, *quiet, f"initial.weights_file={path}", f"run_dir={folder}/some") == 0
    every, some = (json.loads((folder / d / "metrics.json").read_text()) for d in ("all", "some"))
    assert some["srmse"] == every["srmse"]
    capsys.readouterr()
    assert run(monkeypatch, *quiet, f"initial.weights_file={path}", "initial.draw=3") == 2
    assert "holds draws 2, 4, 5; draws 3 to 4 were asked for" in capsys.readouterr().err


def test_one_bad_job_stops_a_multirun_before_it_starts(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "-m", "controller=nn,lstm", "horizon=0.05", f"run_dir={folder}") == 2
    assert not folder.exists()


def test_the_error_of_one_bad_job_names_the_job(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["-m", "controller=nn,hard", "draws=1,0", "horizon=0.05", f"run_dir={folder}"]
    assert run(monkeypatch, *arguments) == 2
    err = capsys.readouterr().err
    assert err == "error: job 1 (controller=nn draws=0): draws = 0: at least 1\n"


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("controler=hard", "unknown setting 'controler'; did you mean controller?"),
        ("solver.dtt=1e-3", "did you mean solver.dt?"),
        ("dt=1e-3", "did you mean solver.dt?"),
        ("memory.zzz=1", "unknown setting 'memory.zzz'; choose from n_slots, reset of memory"),
        ("zzz=1", "choose from problem, plant, reference, controller"),
    ],
)
def test_a_typo_of_a_key_is_told_the_nearest_or_all(
    argument: str,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(monkeypatch, argument) == 2
    err = capsys.readouterr().err
    assert words in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("horizon", "'horizon' is no setting: give NAME=VALUE, see --help"),
        ("memory.n_slots=abc", "memory.n_slots = abc: give a whole number"),
        ("controller.n_hidden=abc", "controller.n_hidden = abc: give a whole number"),
        ("horizon=abc", "horizon = abc: give a number"),
        ("output.figures=maybe", "output.figures = maybe: give true or false"),
        ("initial.weights_file=[1]", "initial.weights_file = [1]: give a text"),
        ("solver.dt=null", "solver.dt = null: give a value, it can't be null"),
        ("memory=3", "memory = 3: it holds settings of its own; give one of them, as "),
        ("plant.masses=[1", "plant.masses=[1: not to be read as NAME=VALUE ("),
    ],
)
def test_a_value_of_the_wrong_kind_is_told_what_is_wanted(
    argument: str,
    said: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(monkeypatch, argument, f"run_dir={folder}") == 2
    err = capsys.readouterr().err
    assert err.startswith(f"error: {said}") and err.count("\n") == 1
    assert err == f"error: {said}\n" or said[-1] in " ("


def test_changes_of_parameters_beyond_the_horizon_are_said(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quiet = ["controller=nn", "output.figures=false", "output.tensorboard=false"]
    jumps = "scenario.schedule.masses=[[0.01,2],[0.05,2],[7,2]]"
    assert run(monkeypatch, *quiet, "horizon=0.05", jumps, f"run_dir={folder}/a") == 0
    err = capsys.readouterr().err
    assert (
        "warning: 2 of 3 changes of parameters, the first at 0.05 s, come after the horizon" in err
    )
    jumps = "scenario.schedule.masses=[[0.01,2]]"
    assert run(monkeypatch, *quiet, "horizon=0.05", jumps, f"run_dir={folder}/b") == 0
    assert "warning" not in capsys.readouterr().err


@pytest.fixture
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scenario 7 and a controller of one's own."""
    base = tmp_path_factory.mktemp("own")
    for group, like, name in (("scenario", "1", "7"), ("controller", "nn", "small")):
        text = (CONF / group / f"{like}.yaml").read_text().replace(f"name: {like}", f"name: {name}")
        (base / group).mkdir()
        (base / group / f"{name}.yaml").write_text(text.replace('name: "1"', 'name: "7"'))
    table = "{title: Mine, scenario: '7', rows: [{variant: nn, label: NN}]}"
    (base / "experiment").mkdir()
    (base / "experiment" / "mine.yaml").write_text(f"# @package tables.mine\n{table}\n")
    return base


@pytest.mark.parametrize("option", ["--config-dir={}", "--config-dir {}", "hydra.searchpath=[{}]"])
def test_own_groups_are_found(
    option: str, own: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = option.format(own).split(" ")
    quiet = ["horizon=0.02", "output.figures=false", "output.tensorboard=false"]
    chosen = ["scenario=7", "controller=small"]
    assert run(monkeypatch, *where, *chosen, *quiet, f"run_dir={folder}") == 0
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["scenario"] == "7" and metrics["controller"] == "small"


@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        ("reproduce", ["experiment=[mine]"]),
        ("tune", ["controller=small", "names=[base_gain]", "train.scenarios=['7']"]),
        ("gradient_report", ["scenario=7", "keys=state"]),
    ],
)
def test_own_groups_are_found_by_every_command(
    command: str,
    arguments: list[str],
    own: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    main = importlib.import_module(f"experiments.{command}").main
    shown = [f"run_dir={folder}", "--cfg", "job", f"--config-dir={own}"]
    assert exit_code(monkeypatch, main, *arguments, *shown) == 0
    out, err = capfd.readouterr()
    assert '"7"' in out.replace("'", '"') and err == ""


def test_own_groups_are_offered_and_a_missing_folder_is_named(
    own: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "--help", f"--config-dir={own}") == 0
    assert "illustration" in (out := capsys.readouterr().out) and ", 6, 7, " in out
    for option in ("--config-dir=/nowhere", "hydra.searchpath=[/nowhere]"):
        assert run(monkeypatch, option, "scenario=7") == 2
        assert "'/nowhere' is not a folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("python -m experiments.simulate scen", {"scenario=", "scenario."}),
        ("mann-simulate scenario=1 solver.d", {"solver.dt=", "solver.device="}),
        ("python3 -m experiments.simulate scenario=4", {"scenario=4", "scenario=4_offset"}),
    ],
)
def test_tab_completes(
    line: str, words: set[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COMP_LINE", line)
    monkeypatch.setenv("COMP_POINT", str(len(line)))
    assert run(monkeypatch, "-sc", "query=bash") == 0
    assert words <= set(capsys.readouterr().out.split())


def test_the_shell_is_told_how_to_complete(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "-sc", "install=bash") == 0
    assert "complete " in capsys.readouterr().out


def test_help_needs_no_torch() -> None:
    code = (
        "import runpy, sys\nsys.argv = ['simulate', '--help']\n"
        "try: runpy.run_module('experiments.simulate', run_name='__main__')\n"
        "except SystemExit: print('torch' in sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert out.stdout.endswith("False\n") and "scenario=5" in out.stdout


@pytest.mark.slow
def test_a_run_without_pictures_imports_no_plotting(tmp_path: Path) -> None:
    foreign = ("matplotlib", "scipy", "torchdiffeq", "tensorboard")
    quiet = ["horizon=0.02", "output.figures=false", "output.tensorboard=false"]
    quiet += ["solver.engine=torch", f"run_dir={tmp_path}/run"]
    code = (
        f"import sys\nsys.argv = {['simulate', *quiet]}\n"
        "from experiments import simulate\nsimulate.main()\n"
        f"print([name for name in {(*foreign, 'torch._dynamo')} if name in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert out.stdout.splitlines()[-1] == "[]", out.stderr


def test_a_finished_run_is_skipped_and_never_overwritten(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quiet = ["controller=nn", "horizon=0.05", "output.figures=false", f"run_dir={folder}"]
    assert run(monkeypatch, *quiet) == 0
    before = (folder / "metrics.json").read_bytes()
    capsys.readouterr()
    assert run(monkeypatch, *quiet) == 0
    assert f"finished already, skipped: {folder}" in capsys.readouterr().out
    assert run(monkeypatch, *quiet, "seed=3") == 2
    said = capsys.readouterr().err
    assert "already holds a run of other settings (initial.seed = " in said or "seed = " in said
    assert run(monkeypatch, *quiet[:-1], f"hydra.run.dir={folder}") == 0
    assert (folder / "metrics.json").read_bytes() == before


@pytest.mark.slow
def test_a_sweep_goes_on_where_it_stopped(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quiet = ["-m", "controller=nn", "horizon=0.02", "output.figures=false", f"run_dir={folder}"]
    assert run(monkeypatch, *quiet, "seed=1,2") == 0
    kept = (folder / "0" / "metrics.json").read_bytes()
    done = (folder / "1" / "trajectory.npz").read_bytes()
    (folder / "1" / "metrics.json").unlink()
    assert run(monkeypatch, *quiet, "seed=1,2") == 0
    assert capsys.readouterr().out.count("skipped") == 1
    assert (folder / "0" / "metrics.json").read_bytes() == kept
    assert (folder / "1" / "trajectory.npz").read_bytes() == done
    assert run(monkeypatch, *quiet, "seed=5,6") == 2
    assert "already holds a run of other settings" in capsys.readouterr().err


def test_a_run_dir_below_a_file_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.write_text("a file")
    assert run(monkeypatch, "horizon=0.02", f"run_dir={folder / 'x'}") == 2
    assert "not a folder" in capsys.readouterr().err


numbers = st.sampled_from(["nan", "-1", "inf", "-inf", "0", "x", "[1]", "null", "{a:1}", "''"])
names = st.sampled_from(
    [
        "solver.dt",
        "horizon",
        "constants.base_gain",
        "constants.error_gain",
        "constants.write_gain",
        "plant.masses",
        "plant.lengths",
        "draws",
        "memory.n_slots",
        "scenario.horizon",
        "plant",
    ]
)


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(name=names, value=numbers)
def test_random_bad_values_never_raise_or_leave_a_folder(
    name: str, value: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    if value == "null" and name in ("horizon", "plant.masses", "plant.lengths"):
        return  # null is how they say "the scenario's own", "the plant's own"
    folder = tmp_path_factory.mktemp("bad") / "run"
    with pytest.MonkeyPatch.context() as patch:
        assert run(patch, f"{name}={value}", f"run_dir={folder}") == 2
    assert not folder.exists()


#: One of them is quick enough for every test run.
_HELP = [pytest.param(c, marks=[] if c == "simulate" else [pytest.mark.slow]) for c in HELP]


@pytest.mark.parametrize("command", _HELP)
def test_help_says_what_for_and_its_examples_compose(
    command: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    main = importlib.import_module(f"experiments.{command}").main
    assert exit_code(monkeypatch, main, "--help") == 0
    out, said = capfd.readouterr().out, HELP[command]
    assert out.startswith(said.purpose)
    assert all(name in out for group in said.groups for name in group_names(group))
    assert all(name in out for names in said.choices().values() for name in names)
    for example in said.examples.values():
        assert example in out
        for overrides in jobs_of(quote_numeric_names(shlex.split(example))):
            mine = [o for o in overrides if not o.startswith("hydra/launcher=")]  # an extra
            cli.compose_job(command, mine)


def test_run_folders_of_runs_started_at_once_differ() -> None:
    from experiments.command.hydra_setup import _run_folder

    folders = {_run_folder(None, "simulate") for _ in range(200)}
    assert len(folders) == 200
    assert all(re.match(r"logs/simulate/\d{8}-\d{6}-\d{6}-", f) for f in folders)
