"""Scorecard F1: the library's checks raise under `python -O`, where every assert is gone."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = """
import torch
import mann_torch as mt
from tests.conftest import make_controller, make_scenario
from tests.simulation.broken import NaNLoad

assert False, "never reached under -O"

def refused(kind, call):
    try:
        call()
    except kind:
        return
    raise SystemExit(f"no {kind.__name__} from {call.__code__.co_firstlineno}")

nan = float("nan")
refused(mt.DomainError, lambda: mt.arm_parameters([nan, 1.0]))
refused(mt.DomainError, lambda: mt.arm_parameters([-1.0, 1.0]))
refused(mt.ShapeError, lambda: mt.arm_parameters([1.0, 1.0, 1.0]))
refused(mt.ConfigError, lambda: mt.Implicit(nan))
refused(mt.ConfigError, lambda: mt.Odeint("rk4", -1.0))
refused(mt.DomainError, lambda: mt.MannController(2, 3, base_gain=nan))
refused(mt.ConfigError, lambda: mt.MannController(2, 0))
refused(mt.ConfigError, lambda: mt.Sinusoid([nan, 1.0]))
refused(mt.ConfigError, lambda: mt.Odeint("rk4", max_step=1e-12))
loop = mt.ClosedLoop(NaNLoad(), make_controller("nn"))
for solver in (mt.Implicit(5e-3), mt.Odeint("dopri5", max_evaluations=200)):
    with torch.no_grad():
        run = mt.rollout(loop, make_scenario(0.05), solver, engine="torch")
    if run.describe_status() != ["diverged at t = 0.025 s: q not finite"]:
        raise SystemExit(f"{solver.name}: {run.describe_status()}")
print("all refused")
"""

#: torchdiffeq says by asserts alone that its step underflows, or that its state is not finite.
ROLLOUTS = """
import torch
import mann_torch as mt
from tests.conftest import make_controller, make_loop, make_scenario
from tests.simulation.broken import NaNLoad, SingularArm
from tests.simulation.papers import side

assert False, "never reached under -O"
torch.set_num_threads(1)
few = {"max_evaluations": 500}
for plant in (NaNLoad, SingularArm):
    loop = mt.ClosedLoop(plant(), make_controller("nn"))
    for solver in (mt.Implicit(5e-3), mt.Odeint("dopri5", **few), mt.Odeint("scipy_solver", **few)):
        with torch.no_grad():
            run = mt.rollout(loop, make_scenario(0.1), solver, engine="torch")
        print(plant.__name__, solver.name, *run.describe_status())
strict = mt.Odeint("dopri5", rtol=1e-9, atol=1e-12, **few)
print("chattering", *side("hard", ("6",), 0.06).run(solver=strict).describe_status())
hopeless = mt.Odeint("dopri5", rtol=1e-30, atol=1e-30, **few)
with torch.no_grad():
    print("hopeless", *mt.rollout(make_loop("nn"), make_scenario(0.1), hopeless).describe_status())
loop = make_loop("nn")
with torch.no_grad():
    loop.controller.constant("base_gain").fill_(float("inf"))
try:
    mt.rollout(loop, make_scenario(0.1))
except mt.DomainError as error:
    print(error)
"""
TOLD = """\
NaNLoad implicit diverged at t = 0.025 s: q not finite
NaNLoad dopri5 diverged at t = 0.025 s: q not finite
NaNLoad scipy_solver diverged at t = 0.025 s: q not finite
SingularArm implicit diverged at t = 0.025 s: q not finite
SingularArm dopri5 diverged at t = 0.025 s: q not finite
SingularArm scipy_solver diverged at t = 0.025 s: q not finite
chattering diverged at t = 0.035 s: q not finite
hopeless diverged at t = 0 s: q not finite
base_gain = inf is outside its domain: must be finite and > 0
"""


def optimized(script: str) -> str:
    """What a script prints under -O."""
    command = [sys.executable, "-O", "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_bad_input_is_refused_without_asserts() -> None:
    assert optimized(SCRIPT) == "all refused\n"


@pytest.mark.slow
def test_rollouts_that_fail_say_so_without_asserts() -> None:
    assert optimized(ROLLOUTS) == TOLD
