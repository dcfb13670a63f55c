"""Problem 7 (Karason and Annaswamy 1994) by deployed controllers: x' = x + sat(u), |u| <= 10."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
import torch

import mann_torch as mt
from experiments.building.build import build
from experiments.building.ensembles import composed
from mann_torch.deployment import SATURATED

from .c_calling import InC

PERIOD, TICKS = 1e-3, 10_000


class Ran(NamedTuple):
    x: float
    estimates: list[float]
    saturated: int


Deployed = Callable[[str], mt.Stepper | InC]


@pytest.fixture(params=["in Python", "in C"])
def deployed(request: pytest.FixtureRequest, tmp_path: Path) -> Deployed:
    def made(problem: str) -> mt.Stepper | InC:
        stepper = mt.deploy(build(composed((f"problem={problem}",))).loop, PERIOD)
        return stepper if request.param == "in Python" else InC(stepper, tmp_path / "out")

    return made


def ran(stepper: mt.Stepper | InC, start: float = -9.99, adapt: bool = True) -> Ran:
    """Ten seconds with the plant's exact steps under a held input."""
    growth = math.exp(PERIOD)
    x, saturated = start, 0
    times = PERIOD * torch.arange(TICKS, dtype=torch.float64)
    # The reference of the problem: 5 sin(0.5 t).
    commands = (5.0 * torch.sin(0.5 * times))[:, None]
    state = stepper.initial_state(commands[0], torch.tensor([x], dtype=torch.float64))
    for command in commands:
        measured = torch.tensor([x], dtype=torch.float64)
        u, state, flags = stepper.step(state, command, measured, adapt)
        assert flags in (0, SATURATED) and abs(float(u)) <= 10.0
        saturated += flags == SATURATED
        x = growth * x + (growth - 1.0) * float(u)
    weights = stepper.unpacked(state).controller.adaptive.network.W
    return Ran(x, weights.flatten().tolist(), saturated)


def test_the_protection_holds(deployed: Deployed) -> None:
    """Printed at 10 s: x = -4.50622, theta = -2.16608, k = 1.11085; to the period."""
    found = ran(deployed("limited_input"))
    assert found.saturated > 1000
    assert found.x == pytest.approx(-4.50622, rel=0.01)
    assert found.estimates == pytest.approx([-2.16608, 1.11085], rel=0.002)


def test_without_it_the_gain_winds_up(deployed: Deployed) -> None:
    """Printed: theta(10 s) = -62.471."""
    found = ran(deployed("limited_input_unprotected"))
    assert found.estimates[0] == pytest.approx(-62.471, rel=0.01)


def test_frozen_and_saturated_it_stays_as_it_is(deployed: Deployed) -> None:
    found = ran(deployed("limited_input"), adapt=False)
    assert found.saturated > 1000 and found.estimates == [-2.2, 1.1]
