"""Scorecard G6: what the gradient of 330 s takes in memory, and how that grows with the horizon."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
#: SRMSE of scenario 1 to all constants of soft attention; the process's high water mark only grows.
CODE = """
import json, torch, mann_torch as mt
from experiments.runs.workers import peak_mb
from tests.simulation.papers import side

def gradient(horizon):
    made = side("soft", ("1",), horizon)
    controller = made.loop.controller
    free = controller.tune(*controller.constants())
    run = mt.rollout(made.loop, made.scenario, mt.Implicit({dt}), weights=made.weights,
                     engine="{engine}", sample_until=0.0)
    slopes = torch.autograd.grad(mt.srmse(run).sum(), free)
    assert all(bool(torch.isfinite(s).all()) for s in slopes)
    return peak_mb()

torch.set_num_threads(1)
start = gradient(0.2)
print(json.dumps([gradient(horizon) - start for horizon in {horizons}]))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("engine", "dt", "horizons"),
    [
        ("compiled", 1e-3, [41.25, 82.5, 165.0, 330.0]),
        # Some 6 ms a step, forwards and backwards: steps of 10 ms for minutes' sake.
        ("torch", 1e-2, [20.0, 60.0, 330.0]),
    ],
)
def test_the_gradient_of_330_seconds_fits_in_a_gigabyte(
    engine: str,
    dt: float,
    horizons: list[float],
    record_property: Callable[[str, object], None],
) -> None:
    code = CODE.format(engine=engine, dt=dt, horizons=horizons)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    growth = np.array(json.loads(done.stdout)) * 2**20
    slope = np.polyfit(np.array(horizons) / dt, growth, 1)[0]
    record_property("growth [MB]", (growth / 1e6).round(1).tolist())
    record_property("slope [bytes a step]", round(float(slope), 1))
    print(f"{engine}: {growth / 1e6} MB, {slope:.1f} bytes a step")
    assert growth[-1] <= 1e9
