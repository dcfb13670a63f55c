"""Scorecard F1: the library's checks raise under `python -O`, where every assert is gone."""

import subprocess
import sys

SCRIPT = """
import torch
import mann_torch as mt

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
print("all refused")
"""


def test_bad_input_is_refused_without_asserts() -> None:
    done = subprocess.run([sys.executable, "-O", "-c", SCRIPT], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "all refused\n"), done.stderr
