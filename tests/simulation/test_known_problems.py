"""Benchmark problems with known answers, their controllers written as a user would."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.functional import outer, times_column
from mann_torch.plants import PlanarQuadrotor
from mann_torch.signals import Disturbance, Polynomial, Sinusoids, Sum
from mann_torch.types import Measurement


class Adapted(NamedTuple):
    A: Tensor  # (..., 3, 1)


class WindSignals(NamedTuple):
    input: Tensor  # (..., 3)


class WindController(mt.Controller):
    """u = B^-1 (v' + g - A y - K s), A' = P s y', y = 1: problem 1's "PID"."""

    reference_order = 2

    def initial_state(
        self, reference: Any, measurement: Any, batch_shape: Any, generator: Any = None,
        weights: Any = None,
    ) -> Any:  # fmt: skip
        return Adapted(torch.zeros(*batch_shape, 3, 1, dtype=torch.float64)), None

    def forward(self, reference: Any, measurement: Any, state: Any, mode: Any) -> mt.ControlOutput:
        r, dr, ddr = reference.upto(2)
        e, de = measurement.q - r, measurement.qd - dr
        s, y = de + e, torch.ones_like(e[..., :1])
        gravity = torch.tensor([0.0, 9.81, 0.0], dtype=torch.float64)
        tau = ddr - de + gravity - times_column(state.A, y) - 10.0 * s
        cos, sin = torch.cos(measurement.q[..., 2]), torch.sin(measurement.q[..., 2])
        t_1, t_2, t_3 = tau.unbind(-1)
        u = torch.stack([cos * t_2 - sin * t_1, t_3, cos * t_1 + sin * t_2], dim=-1)
        return mt.ControlOutput(u, Adapted(10.0 * outer(s, y)), WindSignals(u))


def test_quadrotor_in_wind_has_the_published_figures() -> None:
    """Problem 1 (published float32: 4 digits), held for 0.01 s and adapted by the trapezoid."""
    w = 2 * math.pi / 10.0
    swing = Sinusoids([[2.0, 3.0, 0.0]], w, [[0.0, -math.pi / 2, 0.0]], offset=[0.0, 3.0, 0.0])
    rise = 4 * math.pi / 3 / 10.0
    line = Polynomial([[0.0, 0.0, 0.0], [0.4, 0.0, rise], [0.0, 0.0, -rise / 10.0]])
    signal = Sum([swing, line])
    begin = signal(torch.zeros((), dtype=torch.float64))
    plant = PlanarQuadrotor()
    scenario = mt.Scenario(
        signal, plant.parameters_of(), 10.0,
        start=mt.PlantState(begin.value, begin.rate),
        disturbance=Disturbance(plant=Polynomial([[6.5]])),
    )  # fmt: skip
    loop = mt.ClosedLoop(plant, WindController(), clock=mt.Clock(0.01))
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(0.0025), sample_dt=0.01, sample_until=10.0)
    t, q, qd = run.sample_t, run.states.plant.q, run.states.plant.qd
    assert len(t) == 1001
    r = signal(t)
    e = torch.cat([q - r.value, qd - r.rate], dim=-1).norm(dim=-1)
    assert abs(float(e.square().mean().sqrt()) - 0.912149) <= 1e-4
    assert abs(float(e.max()) - 1.148057) <= 1e-4
    torch.testing.assert_close(
        q[500], torch.tensor([2.888483, 5.705446, 1.047198]).double(), rtol=0, atol=2e-4
    )
    # The command of a tick is what is held one sample later; that of 10 s is one more tick.
    made, seen, end = loop.controller, Measurement(q[-1], qd[-1]), signal(t[-1])
    A = run.states.controller.A[-1]
    ahead = made(end, seen, Adapted(A), None).d_state.A
    A = A + 0.005 * (run.held.clock.rates.A[-1] + ahead)
    last = made(end, seen, Adapted(A), None).input
    u = torch.cat([run.held.clock.input[1:], last.unsqueeze(0)])
    assert abs(float(u.square().sum(-1).mean().sqrt()) - 32.916096) <= 1e-4
