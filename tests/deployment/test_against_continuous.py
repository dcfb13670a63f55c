"""A clocked loop against the continuous one: the paper's illustration, 60 s."""

from __future__ import annotations

import itertools

import pytest
import torch

import mann_torch as mt
from tests.simulation.papers import CONTROLLERS, Side, side


def run(s: Side, period: float | None = None) -> tuple[torch.Tensor, torch.Tensor]:
    """SRMSE (n,) and q at whole 50 ms."""
    clock = None if period is None else mt.Clock(period)
    loop = mt.ClosedLoop(s.loop.plant, s.loop.controller, clock=clock)
    step = 1e-3 if period is None else min(period, 1e-3)
    found = s._replace(loop=loop).run(solver=mt.Implicit(step), sample_dt=0.05)
    return mt.srmse(found)[0], found.states.plant.q


def changed(s: Side, period: float) -> float:
    """Largest change of a joint's SRMSE."""
    return float((run(s, period)[0] / run(s)[0] - 1.0).abs().max())


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_at_1_khz_errors_are_within_one_percent(name: str) -> None:
    assert changed(side(name, ("illustration",), horizon=60.0), 1e-3) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nn", "soft"])
def test_the_difference_falls_with_the_period(name: str) -> None:
    """Slope 1: a held command is late by half a period on average."""
    s = side(name, ("illustration",), horizon=60.0)
    exact = run(s)[1]
    rms = [(run(s, p)[1] - exact).square().mean().sqrt() for p in (2.5e-4, 5e-4, 1e-3)]
    for fine, coarse in itertools.pairwise(rms):
        assert float((coarse / fine).log2()) > 0.97


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nn", "soft", "hard", "reallocating_initial"])
def test_at_250_hz_a_weaker_gain_is_within_one_percent_and_the_papers_diverges(name: str) -> None:
    """A held feedback is stable only where gain times period stays below twice the inertia."""
    s = side(name, ("illustration",), horizon=60.0)
    assert not bool(run(s, 4e-3)[0].isfinite().all())
    s.loop.controller.initialize(robust_gain=3.0)
    assert changed(s, 4e-3) < 0.01
