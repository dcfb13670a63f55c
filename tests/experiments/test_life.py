"""Runs that are stopped, repeated, crowded and starved of room."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from experiments import peers, reproduce, simulate
from experiments.runs.life import claimed, finish
from mann_torch.errors import ConfigError
from tests.experiments.command import exit_code

ROOT = Path(__file__).parents[2]
QUIET = ["controller=nn", "horizon=0.05", "output.figures=false", "output.tensorboard=false"]
COMMANDS = {
    "simulate": ["simulate", "controller=nn", "horizon=1", "draws=2", "output.animation=true"],
    "reproduce": ["reproduce", "experiment=[table_1]", "horizon=0.2", "draws=2", "workers=1"],
    "tune": [
        *("tune", "horizon=0.08", "effort_after=0.02", "train.draws=[0,1]", "judge=false"),
        *("names=[write_gain,error_gain]", "schedule.iterations=6", "schedule.minibatch=3"),
    ],
    "sweep": ["simulate", "-m", "controller=nn,soft", "seed=1,2,3", "horizon=0.3"],
}
#: Killed fewer times: they go on in the same ways.
OTHERS = {
    "ensemble": ["ensemble", "horizon=1", "rollouts=40", "chunk=10", "workers=1"],
    "gradient_report": [
        *("gradient_report", "horizon=0.1", "draws=2", "names=[error_gain]", "steps=[0.1]"),
        *("temperatures=[]", "horizons=[]"),
    ],
    "peers": [
        *("peers", "tasks=[recall]", "variants=[memory,lstm]", "recall.iterations=100", "seeds=2"),
        *("tested=20", "workers=1"),
    ],
    "ablation": [
        *("ablation", "tables=[online]", "online.variants=[plain,readouts_3,wiped_5]"),
        *("online.visits=2", "online.visit_length=2", "online.rates=[10]", "online.seeds=2"),
        "workers=1",
    ],
    "online_regression": [
        *("online_regression", "variants=[network,soft]", "rates=[1]", "visits=2", "seeds=2"),
        *("n_functions=2", "visit_length=2", "dt=0.05", "window=0.5", "workers=1"),
    ],
    "tune_problems": [
        *("tune_problems", "problems=[rohrs]", "train=2", "held_out=4", "iterations=6"),
        "workers=1",
    ],
    "export": ["export", "controller=nn", "export.learned=true", "horizon=2"],
    "returning": [
        *("returning", "variants=[plain,memory_1]", "visits=2", "visit_length=2", "window=1"),
        *("draws=2", "workers=1"),
    ],
}


def settings(**values: Any) -> Any:
    return OmegaConf.create({"draws": 3, "run_dir": None, "inner": {"dt": 0.1}, **values})


def start(folder: Path, *arguments: str, **options: Any) -> subprocess.Popen[str]:
    """A command in a process of its own, its run in `folder`."""
    command = [sys.executable, "-m", f"experiments.{arguments[0]}", *arguments[1:]]
    return subprocess.Popen(
        [*command, f"run_dir={folder}"],
        cwd=options.pop("cwd", folder.parent),
        env={**os.environ, "PYTHONPATH": str(ROOT), **options.pop("env", {})},
        stdout=options.pop("stdout", subprocess.PIPE),
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def lines_of(process: subprocess.Popen[str]) -> list[str]:
    """What a failed command says on stderr, without the bar."""
    _, said = process.communicate(timeout=120)
    lines = said.replace("\r", "\n").splitlines()
    return [line for line in lines if line and "it/s" not in line and "mass jumps" not in line]


def test_a_folder_is_of_one_process_at_a_time(tmp_path: Path) -> None:
    with claimed(tmp_path / "run", settings()) as finished:
        assert not finished
        with (
            pytest.raises(ConfigError, match=f"process {os.getpid()} is at work there"),
            claimed(tmp_path / "run", settings()),
        ):
            pass
    with claimed(tmp_path / "run", settings()):
        pass


def test_other_settings_are_refused_by_name_and_where_it_works_is_none(tmp_path: Path) -> None:
    with claimed(tmp_path, settings()):
        finish(tmp_path, {"srmse": 1.0})
    with claimed(tmp_path, settings(run_dir="elsewhere", workers=7)) as finished:
        assert finished
    other = settings(inner={"dt": 0.2})
    with (
        pytest.raises(ConfigError, match=r"inner.dt = 0.1 there, 0.2 here"),
        claimed(tmp_path, other),
    ):
        pass


def test_what_a_killed_run_left_half_is_removed(tmp_path: Path) -> None:
    with claimed(tmp_path, settings()):
        pass
    half = [tmp_path / ".trajectory.npz.0a1b2c3d", tmp_path / "events.out.tfevents.1.host"]
    mine = [tmp_path / "notes.txt", tmp_path / ".hidden"]
    for path in (*half, *mine):
        path.write_text("x")
    with claimed(tmp_path, settings()):
        assert not any(path.exists() for path in half) and all(path.exists() for path in mine)


@pytest.mark.slow
def test_a_second_process_on_the_same_folder_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    first = start(folder, "simulate", "controller=nn", "solver.engine=torch", "horizon=300")
    deadline = time.monotonic() + 60
    while not (folder / "config.yaml").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    second = start(folder, "simulate", "controller=nn", "solver.engine=torch", "horizon=300")
    (line,) = lines_of(second)
    assert second.returncode == 2 and f"process {first.pid} is at work there" in line
    first.send_signal(signal.SIGKILL)
    first.wait()
    assert not (folder / "metrics.json").exists()


@pytest.mark.slow
def test_finished_variants_are_not_computed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*COMMANDS["reproduce"][1:], f"run_dir={tmp_path / 'run'}"]
    assert exit_code(monkeypatch, reproduce.main, *arguments) == 0
    tables = (tmp_path / "run" / "tables.csv").read_bytes()
    kept = sorted((tmp_path / "run" / "runs").glob("*.npz"))
    kept[0].unlink()
    kept[1].write_bytes(b"half a file")
    (tmp_path / "run" / "metrics.json").unlink()
    capsys.readouterr()
    assert exit_code(monkeypatch, reproduce.main, *arguments) == 0
    assert f"{len(kept) - 2} of {len(kept)} parts were finished before" in capsys.readouterr().out
    assert (tmp_path / "run" / "tables.csv").read_bytes() == tables


def test_finished_trainings_are_not_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["tasks=[recall]", "variants=[memory,lstm]", "recall.iterations=40", "seeds=2"]
    arguments += [
        "tested=20",
        "workers=1",
        "output.figures=false",
        "output.tensorboard=false",
        f"run_dir={tmp_path / 'run'}",
    ]
    assert exit_code(monkeypatch, peers.main, *arguments) == 0
    before = dict(np.load(tmp_path / "run" / "arrays.npz"))
    (tmp_path / "run" / "metrics.json").unlink()
    (tmp_path / "run" / "finished" / "recall_lstm_1.npz").unlink()
    capsys.readouterr()
    assert exit_code(monkeypatch, peers.main, *arguments) == 0
    assert "3 of 4 parts were finished before" in capsys.readouterr().out
    after = dict(np.load(tmp_path / "run" / "arrays.npz"))
    assert before.keys() == after.keys()
    assert all(np.array_equal(before[k], after[k]) for k in before if "seconds" not in k)


#: What no two runs have alike: time and memory.
MEASURED = ("wall_s", "tuning_s", "peak_mb", "seconds", "start_s")
#: The same, of a table's rows.
TIMES = ("training [s]", "start [s]", "training_s", "best_s")


def numbers_in(folder: Path) -> dict[str, Any]:
    """All final numbers of a folder's runs but how long they took."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*.npz")):
        for name, array in np.load(path).items():
            if name.rpartition("/")[2] in MEASURED:
                continue
            key = f"{path.relative_to(folder)}/{name}"
            found[key] = (array.dtype.str, array.shape, array.tobytes())
    for path in sorted(folder.rglob("animation.gif")):
        found[str(path.relative_to(folder))] = path.read_bytes()
    for path in sorted(folder.rglob("metrics.json")):
        record = json.loads(path.read_text())
        for name in (*MEASURED, "command"):
            record.pop(name, None)
        for row in record.get("table", []):
            for name in [name for name in row if name.startswith(TIMES)]:
                row.pop(name)
        for row in record.get("history", []):
            row.pop("seconds", None)
        found[str(path.relative_to(folder))] = record
    return found


def waited_for(folder: Path, process: subprocess.Popen[str]) -> float:
    """How long it took until the run was at work, its folder there [s]."""
    began = time.monotonic()
    while not folder.exists() and process.poll() is None:
        time.sleep(0.005)
    return time.monotonic() - began


def kill_and_repeat(tmp_path: Path, name: str, shares: list[float]) -> None:
    """Kill a run after shares of its work, or before (share < 0), and repeat it each time."""
    whole = tmp_path / "whole"
    command = {**COMMANDS, **OTHERS}[name]
    done = start(whole, *command)
    loading, began = waited_for(whole, done), time.monotonic()
    _, said = done.communicate(timeout=300)
    assert done.returncode == 0, said
    work = time.monotonic() - began
    expected = numbers_in(whole)
    assert expected
    met = {"before": 0, "at work": 0, "finished": 0}
    for number, share in enumerate(shares):
        folder = tmp_path / f"{name}_{number}"
        process = start(folder, *command)
        if share >= 0:
            waited_for(folder, process)
        time.sleep(share * work if share >= 0 else (1 + share) * loading)
        process.kill()
        process.communicate()
        ended = (folder / ("sweep.csv" if name == "sweep" else "metrics.json")).exists()
        met["finished" if ended else "at work" if folder.exists() else "before"] += 1
        again = start(folder, *command)
        _, said = again.communicate(timeout=300)
        assert again.returncode == 0, (share, said[-2000:])
        assert numbers_in(folder) == expected, share
        assert not [p for p in folder.rglob(".*.????????") if p.is_file()]
        assert not [p for p in folder.iterdir() if p.name.startswith(".c-")]
        shutil.rmtree(folder)
    print(f"{name}: killed {met} of {loading:.1f} s of loading and {work:.1f} s of work")


@pytest.mark.slow
def test_killed_and_repeated_a_run_is_that_of_the_undisturbed(tmp_path: Path) -> None:
    kill_and_repeat(tmp_path, "simulate", [0.5])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*COMMANDS, *OTHERS])
def test_killed_at_many_moments(name: str, tmp_path: Path) -> None:
    draw = np.random.default_rng(len(name))
    kills = 25 if name in COMMANDS else 4
    kill_and_repeat(tmp_path, name, draw.uniform(-0.1, 1.0, kills).tolist())


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="mounts a file system")
def test_a_full_disk_is_one_line_and_with_room_the_run_finishes(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(disk)])
    if mounted.returncode != 0:
        pytest.skip("no file system may be mounted here")
    try:
        arguments = ("simulate", "controller=nn", "horizon=100", "draws=10", "output.figures=false")
        full = start(disk / "run", *arguments)
        said = lines_of(full)
        assert full.returncode == 1 and len(said) == 1 and "No space left" in said[0], said
        assert not (disk / "run" / "metrics.json").exists()
        subprocess.run(["mount", "-o", "remount,size=100m", str(disk)], check=True)
        again = start(disk / "run", *arguments)
        assert again.wait(timeout=120) == 0 and (disk / "run" / "metrics.json").exists()
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_closed_stdout_is_one_line(tmp_path: Path) -> None:
    process = start(tmp_path / "run", "simulate", *QUIET)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    said = process.stderr.read().strip().splitlines()
    assert process.wait() == 1 and said[-1] == "error: stdout was closed before the end"


def test_help_into_a_closed_pipe_is_one_line() -> None:
    line = [sys.executable, "-m", "experiments.simulate", "--help"]
    process = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b"error: stdout was closed before the end\n"
    assert process.wait() == 1


@pytest.mark.slow
def test_without_stdout_or_stderr_a_run_finishes(tmp_path: Path) -> None:
    for closed in ("1>&-", "2>&-"):
        folder = tmp_path / closed[0]
        line = [sys.executable, "-m", "experiments.simulate", *QUIET, f"run_dir={folder}"]
        done = subprocess.run(
            ["sh", "-c", f'"$@" {closed}', "sh", *line],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0 and (folder / "metrics.json").exists(), done.stderr


@pytest.mark.slow
def test_an_ascii_terminal_is_no_obstacle(tmp_path: Path) -> None:
    arguments = [*COMMANDS["reproduce"], "figures={}"]
    process = start(tmp_path / "run", *arguments, env={"PYTHONIOENCODING": "ascii", "LC_ALL": "C"})
    out, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert "written to" in out


@pytest.mark.parametrize(
    ("argument", "words"),
    [("--foo", "unknown option '--foo'"), ("run_dir=${oops}", "oops"), ("-x=3", "'-x'")],
)
def test_odd_arguments_are_one_line(
    argument: str,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code(monkeypatch, simulate.main, *QUIET, argument) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and words in said and not list(tmp_path.iterdir())


def test_a_run_that_fails_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for error, words in (
        (OSError(28, "No space left on device", "x.npz"), "No space left on device: x.npz"),
        (MemoryError(), "out of memory"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried"), "out of memory"),
        (KeyError("q"), "KeyError"),
    ):

        def broken(*_: object, error: Exception = error) -> None:
            raise error

        monkeypatch.setattr(simulate, "simulate", broken)
        arguments = [*QUIET, f"run_dir={tmp_path / 'run'}"]
        assert exit_code(monkeypatch, simulate.main, *arguments) == 1
        *_, said = capsys.readouterr().err.splitlines()
        assert said.startswith("error: ") and words in said, said


@pytest.mark.parametrize(
    "waits", [(0.8,), pytest.param((0.1, 0.3, 0.5, 1.2, 2.0, 3.0, 4.0), marks=pytest.mark.slow)]
)
def test_ctrl_c_at_any_time_is_one_line(waits: tuple[float, ...], tmp_path: Path) -> None:
    for wait in waits:
        process = start(
            tmp_path / f"run{wait}",
            *("simulate", "controller=nn", "solver.engine=torch", "horizon=60"),
            start_new_session=True,
            # A shell's background jobs, these tests perhaps, ignore Ctrl-C, and so would the run.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        said = lines_of(process)
        assert process.returncode == 130, (wait, process.returncode, said)
        assert len(said) == 1 and "interrupted" in said[0], (wait, said)
