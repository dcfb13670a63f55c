"""Scorecard P4: how many right-hand sides each solver evaluates in a simulated second.

A count, the same on every machine. How fast an evaluation is, and the compiled engine against
others, is the benchmark's business.
"""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from experiments.building.build import build
from experiments.building.ensembles import composed
from experiments.command.conf_files import group_names

HORIZON = 0.2  # [s]
#: Evaluations a second under the plain network, scenario 1, first 0.2 s, at the default settings.
BASELINE = {
    "adaptive_heun": 6785,
    "bosh3": 2065,
    "dopri5": 1930,
    "dopri8": 3130,
    "euler": 5000,
    "explicit_adams": 6200,
    "fehlberg2": 2300,
    "heun2": 10000,
    "heun3": 15000,
    "implicit": 500,
    "implicit_adams": 10840,
    "midpoint": 10000,
    "rk4": 20000,
    "runge_kutta": 4000,
    "scipy_solver": 3090,
}
#: Fixed methods take steps of 0.2 ms, a second of computing or two.
QUICK = ("implicit", "bosh3", "dopri5", "dopri8")


class Counting(mt.TwoLinkArm):
    """An arm that counts its mass matrices: one an evaluation."""

    calls = 0

    def mass_matrix(self, q: torch.Tensor, coefficients: object) -> torch.Tensor:
        self.calls += 1
        return super().mass_matrix(q, coefficients)


def test_the_baseline_has_every_solver() -> None:
    assert sorted(BASELINE) == sorted(group_names("solver"))


@pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in BASELINE]
)
def test_a_solver_evaluates_as_often_as_it_did(name: str) -> None:
    made = build(composed(("controller=nn", f"solver={name}", f"horizon={HORIZON}")))
    arm = Counting()
    loop = mt.ClosedLoop(arm, made.loop.controller)
    with torch.no_grad():
        run = mt.rollout(loop, made.scenario, made.solver, weights=made.weights, engine="torch")
    assert run.describe_status() == ["ok"]
    per_second = arm.calls / HORIZON
    assert per_second == pytest.approx(BASELINE[name], rel=0.1)
