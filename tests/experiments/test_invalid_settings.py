"""Scorecard F2: what can't be used is refused in one line, before anything is there."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.lib import format as npy

from experiments.building.build import build
from experiments.building.sizes import rollout_bytes
from experiments.building.weights import inner_weights
from experiments.command.cli import compose_job
from experiments.settings.machine import check_file, check_memory, machine_memory
from experiments.simulate import checked
from mann_torch.errors import ConfigError, WeightsFileError
from mann_torch.simulation.starting import start_of
from mann_torch.trees import leaves
from tests.experiments.command import exit_code
from tests.experiments.invalid_settings import COMMANDS, invalid, too_large

ROOT = Path(__file__).parents[2]


def test_invalid_settings_are_one_line_exit_code_2_and_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    mains = {name: importlib.import_module(f"experiments.{name}").main for name in COMMANDS}
    seen = set()
    for command, arguments in invalid(40, seed=11):
        assert exit_code(monkeypatch, mains[command], *arguments) == 2, (command, arguments)
        out, err = capsys.readouterr()
        assert out == "" and len(err.strip().splitlines()) == 1, (command, arguments, err)
        assert err.startswith("error: ") and "Traceback" not in err
        assert not any(tmp_path.iterdir()), (command, arguments)
        seen.add(command)
    assert seen == set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_size_is_too_large_to_be_refused_at_once(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    main = importlib.import_module(f"experiments.{command}").main
    for arguments in too_large(command):
        began = time.monotonic()
        assert exit_code(monkeypatch, main, *arguments) == 2, arguments
        assert time.monotonic() - began < 20, arguments
        assert capsys.readouterr().err.count("\n") == 1
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
def test_three_hundred_invalid_settings_as_commands(tmp_path: Path) -> None:
    worst = {"lines": 0, "seconds": 0.0, "GB": 0.0}
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for command, arguments in invalid(300, seed=13):
        line = [sys.executable, "-m", f"experiments.{command}", *arguments]
        said = tmp_path.parent / "said.txt"
        with said.open("w") as stderr:
            start = time.monotonic()
            process = subprocess.Popen(line, cwd=tmp_path, env=environment, stderr=stderr)
            _, status, used = os.wait4(process.pid, 0)
            seconds = time.monotonic() - start
        text = said.read_text()
        assert os.waitstatus_to_exitcode(status) == 2, (line, text)
        assert text.startswith("error: ") and not any(tmp_path.iterdir()), (line, text)
        found = (len(text.strip().splitlines()), seconds, 1024 * used.ru_maxrss / 1e9)
        worst = dict(zip(worst, map(max, worst.values(), found), strict=True))
    print(f"300 invalid settings: at most {worst}")
    assert worst["lines"] <= 3 and worst["seconds"] < 20 and worst["GB"] < 2


def test_the_estimate_is_the_size_of_a_state() -> None:
    for controller, keys, plant in (
        *(("nn", "representation", "two_link_arm"), ("soft", "state", "two_link_arm")),
        *(("hard", "state", "n_link_arm"), ("hard", "state", "flexible_joint_arm")),
    ):
        chosen = [f"controller={controller}", f"keys={keys}", f"plant={plant}", "scenario=plain"]
        plain = checked(compose_job("simulate", chosen))
        made = build(plain)
        state = start_of(made.loop, made.scenario, made.weights)[0]
        numbers = sum(leaf.numel() for leaf in leaves(state))
        assert rollout_bytes(plain, made.loop.plant) == 8 * numbers


def test_samples_on_their_way_count_where_a_sensor_holds_many() -> None:
    late = ["sensor.period=1e-4", "sensor.delay=9", "horizon=1", "draws=20000"]
    with pytest.raises(ConfigError, match=r"draws = 20000: needs .* GB of memory or more"):
        checked(compose_job("simulate", [*late, "output.sample_dt=1"]))


def test_what_is_too_large_says_how_large_and_what_there_is() -> None:
    there = machine_memory()
    check_memory("draws", 0.9 * there)
    with pytest.raises(ConfigError, match=r"draws: needs .* GB of memory or more, this machine"):
        check_memory("draws", 1.1 * there)


def unfolding(path: Path, draws: int) -> Path:
    """A weights file of zeros: a thousandth on disk of what it unfolds to."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, shape in (("V_10.npy", (draws, 10, 10)), ("b_v_10.npy", (draws, 10))):
            with archive.open(name, "w", force_zip64=True) as file:
                header = {"descr": "<f8", "fortran_order": False, "shape": shape}
                npy.write_array_header_1_0(file, header)
                for _ in range(draws // 1000):
                    file.write(bytes(8000 * int(np.prod(shape[1:]))))
    return path


@pytest.mark.slow
def test_a_weights_file_that_unfolds_is_read_by_rows_or_refused(tmp_path: Path) -> None:
    large = unfolding(tmp_path / "large.npz", 200_000)
    assert large.stat().st_size < 1e6
    script = (
        "import resource\n"
        "from experiments.building.weights import inner_weights\n"
        "peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "before = peak()\n"
        f"V, _ = inner_weights({str(large)!r}, 10, 10, [3, 199_999])\n"
        "assert V.shape == (2, 10, 10)\n"
        "print(peak() - before)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 60_000  # kB; the array alone would be 160 MB
    with pytest.raises(WeightsFileError, match="draws are more than"):
        inner_weights(str(unfolding(tmp_path / "larger.npz", 2_000_000)), 10, 10, [0])
    with pytest.raises(ConfigError, match="GB of memory"):
        check_file("resume:", huge(tmp_path / "checkpoint.pt"))


def huge(path: Path) -> Path:
    """An archive whose directory claims a file larger than any machine's memory."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data.pkl", b"")
        archive.infolist()[0].file_size = 1 << 62
        archive.infolist()[0].compress_size = 0
    return path


def test_rows_come_as_numpy_reads_them(tmp_path: Path) -> None:
    generator = torch.Generator().manual_seed(0)
    V = torch.randn(5, 10, 10, generator=generator, dtype=torch.float64).numpy()
    b_v = torch.randn(5, 10, generator=generator, dtype=torch.float32).numpy()
    path = tmp_path / "w.npz"
    np.savez_compressed(path, V_10=V, b_v_10=b_v, draws=np.array([4, 7, 5, 0, 9]))
    read_V, read_b = inner_weights(str(path), 10, 10, [9, 7])
    assert (read_V.numpy() == V[[4, 1]]).all() and (read_b.numpy() == b_v[[4, 1]]).all()
