"""A plant and a reference in a package of one's own are found by the command line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = {
    "__init__.py": "",
    "conf/__init__.py": "",
    "conf/plant/tank.yaml": "name: tank\narea: 2.0\n",
    "conf/reference/ramp.yaml": "name: ramp\nslope: 0.1\n",
    "tank.py": '''
from typing import NamedTuple
import torch
from torch import Tensor
from mann_torch.domains import Positive
from mann_torch.plants import Field, Plant
from mann_torch.types import Channel

class Level(NamedTuple):
    level: Tensor  # (..., 1) [m]

class Area(NamedTuple):
    area: Tensor  # (..., 1) [m^2]

class Tank(Plant):
    """area dh/dt = u - leak h."""
    Parameters = Area
    fields = {"area": Field((1.0,), Positive(), "m^2")}
    inputs, outputs = (Channel("inflow", "m^3/s"),), (Channel("level", "m"),)

    def __init__(self, leak=0.1):
        super().__init__()
        self.leak = leak

    def rest(self):
        return Level(torch.zeros(1, dtype=torch.float64))

    def derivative(self, t, state, input, disturbance, coefficients):
        return Level((input.u - self.leak * state.level) / coefficients.area)

    def output(self, state, coefficients):
        return state.level
''',
    "ramp.py": '''
from mann_torch.signals import Reference
from mann_torch.types import ReferenceSample

class Ramp(Reference):
    """slope t."""
    order = 1

    def __init__(self, slope):
        super().__init__()
        self.width = self.hold("slope", slope).shape[-1]

    def at(self, t):
        return ReferenceSample(self.slope * t, self.slope + 0.0 * t)
''',
}
POINTS = """\
[mann_torch.plants]
tank = my_package.tank:Tank
sunk = my_package.sunk:Tank
[mann_torch.references]
ramp = my_package.ramp:Ramp
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `my_package` as installers leave it."""
    base = tmp_path_factory.mktemp("site")
    for name, text in FILES.items():
        path = base / "my_package" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    told = base / "my_package-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: my_package\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text(POINTS)
    return base


def simulate(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    line = [
        sys.executable,
        "-m",
        "experiments.simulate",
        "hydra.searchpath=[pkg://my_package.conf]",
    ]
    line += ["scenario=plain", "controller=linear_feedback", "controller.feedback=[[4.0]]"]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{place}"}
    return subprocess.run(
        [*line, *arguments], cwd=place, env=environment, capture_output=True, text=True
    )


@pytest.mark.slow
def test_it_runs_compiled_with_what_its_class_takes(place: Path) -> None:
    arguments = ["reference=ramp", "plant=tank", "plant.leak=0.0", "plant.area=4", "horizon=2"]
    done = simulate(place, *arguments, "controller.feedforward=[[4.0]]", "run_dir=run")
    assert done.returncode == 0, done.stderr
    record = json.loads((place / "run" / "metrics.json").read_text())
    assert record["engine"] == "compiled"
    # 4 h' = 4 (r - h), r = t / 10: e = (1 - exp(-t)) / 10, of which the mean square is known.
    square = 0.01 * (2.0 - 2.0 * (1 - 2.718281828459045**-2) + (1 - 2.718281828459045**-4) / 2) / 2
    assert record["srmse"][0][0] == pytest.approx(square**0.5, rel=1e-4)
    assert "level" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["plant=tank", "plant.leek=1"], "unknown setting 'plant.leek'; did you mean plant.leak?"),
        (["plant=tonk"], "rohrs, slotine_li_arm, tank, two_link_arm"),
        (["plant=tank", "plant.name=sunk"], "plant 'sunk' can't be loaded from my_package.sunk"),
    ],
)
def test_what_is_wrong_with_it_is_one_line(place: Path, arguments: list[str], said: str) -> None:
    done = simulate(place, *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr and done.stderr.count("\n") == 1
