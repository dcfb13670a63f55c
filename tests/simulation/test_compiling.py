"""Eager PyTorch where there is no compiler; tests/test_golden.py runs compiled steps."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import mann_torch as mt
from mann_torch.simulation.solvers.compiling import CompiledOrEager

ROOT = Path(__file__).parent.parent.parent


@pytest.mark.slow
def test_without_a_compiler_the_run_goes_on_in_eager_and_says_so(tmp_path: Path) -> None:
    environment = {**os.environ, "CXX": "/nonexistent/c++"}
    environment["TORCHINDUCTOR_CACHE_DIR"] = str(tmp_path / "cache")
    command = [sys.executable, "-m", "experiments.simulate", "controller=nn", "horizon=0.05"]
    command += [
        "solver.engine=torch",
        "solver.compile=true",
        f"run_dir={tmp_path / 'run'}",
        "output.tensorboard=false",
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment)
    assert done.returncode == 0
    said = [line for line in (done.stdout + done.stderr).splitlines() if "using eager" in line]
    assert len(said) == 1 and "(eager)" in done.stdout


def test_an_error_of_the_function_itself_is_not_hidden() -> None:
    def broken(x: torch.Tensor) -> torch.Tensor:
        raise mt.ConfigError("mine")

    with pytest.raises(mt.ConfigError, match="mine"):
        CompiledOrEager(broken)(torch.zeros(1))
