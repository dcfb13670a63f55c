"""Work in several processes: results, errors, Ctrl-C, deaths."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import mann_torch as mt
from experiments.runs.workers import at_most, in_parallel

ROOT = Path(__file__).parent.parent.parent


def square(x: int, progress: Callable[[int], object]) -> int:
    progress(1)
    return x * x


def die(x: int, progress: Callable[[int], object]) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return x


@pytest.mark.parametrize("workers", [1, 2])
def test_every_result_comes_with_its_number(workers: int) -> None:
    found = dict(in_parallel(square, [(3,), (4,), (5,)], workers, 3, "job"))
    assert found == {0: 9, 1: 16, 2: 25}


def own_pid(x: int, progress: Callable[[int], object]) -> int:
    return os.getpid()


def test_a_share_of_the_cores_bounds_the_workers() -> None:
    with at_most(1):
        found = dict(in_parallel(own_pid, [(1,), (2,), (3,)], 4, 3, "job"))
    assert set(found.values()) == {os.getpid()}
    with at_most(2):
        found = dict(in_parallel(own_pid, [(1,), (2,), (3,)], 4, 3, "job"))
    assert os.getpid() not in found.values() and len(set(found.values())) <= 2


def test_a_worker_that_dies_is_named() -> None:
    with pytest.raises(mt.SolverError, match="a worker process died"):
        list(in_parallel(die, [(1,), (2,)], 2, 2, "job"))


def children(pid: int) -> list[int]:
    """All processes below `pid`."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    direct = [int(child) for child in path.read_text().split()] if path.exists() else []
    return direct + [below for child in direct for below in children(child)]


def alive(pid: int) -> bool:
    status = Path(f"/proc/{pid}/stat")
    return status.exists() and status.read_text().rsplit(")", 1)[1].split()[0] != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
@pytest.mark.parametrize(
    "stop", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.slow)]
)
def test_stopped_in_the_middle_it_leaves_no_process_and_what_is_finished(
    tmp_path: Path, stop: signal.Signals
) -> None:
    command = [sys.executable, "-m", "experiments.peers", "tasks=[recall]", "variants=[lstm,gru]"]
    command += ["seeds=1", "recall.iterations=50", "shares={lstm:1,gru:1000}", "recall.batch=2"]
    command += [f"run_dir={tmp_path / 'run'}"]
    run = subprocess.Popen(
        command,
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
        # A shell starts background jobs with SIGINT ignored, and that is inherited.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    first = tmp_path / "run" / "finished" / "recall_lstm_0.npz"
    for _ in range(600):
        if first.exists() or run.poll() is not None:
            break
        time.sleep(0.1)
    assert first.exists(), run.stderr
    below = children(run.pid)
    run.send_signal(stop)
    _, said = run.communicate(timeout=20)
    assert run.returncode == (130 if stop == signal.SIGINT else -9)
    if stop == signal.SIGINT:
        assert said.strip().splitlines()[-1].endswith("what was finished has been written")
        assert "Traceback" not in said
    deadline = time.monotonic() + 10
    while any(map(alive, below)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert below and not any(map(alive, below))
    assert first.exists()
