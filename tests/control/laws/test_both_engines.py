"""Every law runs compiled, and has there the gradients that torch gives."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

import mann_torch as mt
from mann_torch.control import (
    AdaptiveLaw,
    Composite,
    ConcurrentLearning,
    ConstantGain,
    DeadZone,
    Drem,
    EModification,
    Estimator,
    Law,
    LawPart,
    LeastSquares,
    Normalisation,
    Projection,
    SigmaModification,
    SwitchingSigma,
)
from mann_torch.plants import Regression
from mann_torch.signals import Polynomial
from tests.control.laws.test_composition import IN_FORCE

ENGINES: dict[str, Callable[[], Law]] = {
    "all together": lambda: AdaptiveLaw(
        LeastSquares(20.0, 0.3, 0.1, 30.0, 10.0),
        *(SigmaModification(0.1), EModification(0.1), SwitchingSigma(0.2, 0.5)),
        *(Composite(0.3), ConcurrentLearning(0.2, 3, 0.02), DeadZone(0.05), Normalisation(0.1)),
        Projection(1.0, 0.1),
    ),
    "concurrent_learning, a cycle": lambda: AdaptiveLaw(
        ConstantGain([2.0, 1.0]), ConcurrentLearning(0.3, 2, 0.02, keeps="cycle")
    ),
    "drem": lambda: Drem([1e8, 2e8], 0.95),
}
ONE_BY_ONE: dict[str, Callable[[], LawPart]] = {
    "least_squares": lambda: LeastSquares([20.0, 10.0], 0.3, 0.1),
    "least_squares, bounded": lambda: LeastSquares(20.0, 0.3, gain_bound=25.0),
    "least_squares, reset": lambda: LeastSquares([[20.0, 1.0], [1.0, 10.0]], 0.3, reset_at=10.0),
    "frozen": lambda: ConcurrentLearning(0.3, points=[[1.0, 2.0]], labels=[[1.0]]),
    **{name: make for name, make in IN_FORCE.items() if name != "concurrent_learning"},
    "concurrent_learning": lambda: ConcurrentLearning(0.3, 2, 0.02),
}
ENGINES |= {name: lambda make=make: AdaptiveLaw(make()) for name, make in ONE_BY_ONE.items()}  # type: ignore[misc]
QUICK = {"least_squares, bounded", "concurrent_learning, a cycle", "drem"}


@pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in ENGINES]
)
def test_every_law_runs_compiled_with_the_gradients_of_torch(name: str) -> None:
    plant, found = Regression(), []
    scenario = mt.Scenario(Polynomial([[0.0]]), plant.parameters_of(), 0.2)
    for engine in ("torch", "compiled"):
        loop = mt.ClosedLoop(plant, Estimator(ENGINES[name](), start=0.7))
        tuned = dict(zip(loop.constants(), loop.tune(*loop.constants()), strict=True))
        run = mt.rollout(loop, scenario, mt.RungeKutta(5e-3), engine=engine)
        run.output.square().sum().backward()
        slopes = {n: torch.zeros(()) if x.grad is None else x.grad for n, x in tuned.items()}
        found.append((run.states.controller.theta.detach(), run.output.detach(), slopes))
    torch.testing.assert_close(found[0][:2], found[1][:2], rtol=0, atol=1e-12)
    for constant, slope in found[0][2].items():
        torch.testing.assert_close(
            slope, found[1][2][constant], rtol=1e-10, atol=1e-10, check_dtype=False
        )
        assert constant == "reset_at" or bool((slope != 0).any()), constant
