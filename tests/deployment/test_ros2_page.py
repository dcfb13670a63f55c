"""docs/ros2.md: its controller is compiled against stand-ins of ROS's headers, and run."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import torch

import mann_torch as mt
from tests.conftest import make_controller
from tests.pages import text_of

HEADERS = Path(__file__).parent / "ros2"


def rows(count: int, first: int = 0) -> list[tuple[torch.Tensor, torch.Tensor]]:
    g = torch.Generator().manual_seed(first)
    given = torch.randn(count, 10, generator=g, dtype=torch.float64)
    # Activation starts from the joints as they are, at rest.
    given[0, :2] = given[0, 6:8]
    given[0, 2:6] = 0.0
    return [(row[:6], row[6:]) for row in given]


@pytest.mark.slow
def test_the_controller_runs_as_the_stepper_does(tmp_path: Path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler g++ here")
    stepper = mt.deploy(make_controller("reallocating_initial"), 1e-3)
    stepper.to_c(tmp_path / "controller")
    (code,) = re.findall(r"```cpp\n(.*?)```", text_of("ros2.md"), re.S)
    (tmp_path / "adaptive_controller.cpp").write_text(code)
    include = [f"-I{folder}" for folder in (HEADERS, tmp_path, tmp_path / "controller")]
    made, program = tmp_path / "controller.o", tmp_path / "manager"
    strict = ["-Wall", "-Wextra", "-Werror", "-O1"]
    source = str(tmp_path / "controller" / "controller.c")
    subprocess.run(["gcc", "-std=c99", *strict, "-c", source, "-o", str(made)], check=True)
    subprocess.run(
        [
            *("g++", "-std=c++17", *strict, *include, str(HEADERS / "manager.cpp")),
            *(str(made), "-lm", "-o", str(program)),
        ],
        check=True,
    )
    kept = tmp_path / "state"
    given = rows(200)
    state = stepper.initial_state(*given[0])
    for part in (given[:100], given[100:]):  # the second goes on from the file
        text = "\n".join(" ".join(repr(float(x)) for x in torch.cat(row)) for row in part)
        done = subprocess.run([str(program), str(kept)], input=text, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found = torch.tensor(
            [[float(x) for x in line.split()] for line in done.stdout.splitlines()],
            dtype=torch.float64,
        )
        expected = []
        for row in part:
            u, state = stepper(state, *row)
            expected.append(u)
        torch.testing.assert_close(found, torch.stack(expected), rtol=1e-11, atol=1e-11)
