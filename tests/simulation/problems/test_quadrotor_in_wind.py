"""Problem 1: features learned for a quadrotor in wind. Published in float32: 4 digits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import (
    AdaptiveLaw,
    Basis,
    Constant,
    ConstantGain,
    Layers,
    LinearNetwork,
    MetaAdaptive,
)
from mann_torch.plants import PlanarQuadrotor
from mann_torch.signals import Disturbance, Polynomial, Sinusoids, Sum
from mann_torch.types import Measurement

FEATURES = Path(__file__).parents[3] / "experiments/problems/data/pfar_features.npz"
T, PERIOD = 10.0, 0.01


class Known(NamedTuple):
    rms: float
    input: float
    peak: float
    middle: list[float]


#: RMS of the 6 errors, RMS of u, largest |e|, q(5 s), as published.
KNOWN = {
    "pid": Known(0.912149, 32.916096, 1.148057, [2.888483, 5.705446, 1.047198]),
    "learned": Known(0.050251, 31.629438, 0.108807, [2.017055, 6.000923, 1.047198]),
}


def basis_of(name: str) -> Basis:
    return Constant(6) if name == "pid" else Layers.of_file(str(FEATURES))


def signal() -> mt.Reference:
    w, rise = 2 * math.pi / T, 4 * math.pi / 3 / T
    swing = Sinusoids([[2.0, 3.0, 0.0]], w, [[0.0, -math.pi / 2, 0.0]], offset=[0.0, 3.0, 0.0])
    line = Polynomial([[0.0, 0.0, 0.0], [4.0 / T, 0.0, rise], [0.0, 0.0, -rise / T]])
    return Sum([swing, line])


def controller_of(name: str) -> MetaAdaptive:
    plant = PlanarQuadrotor()
    network = LinearNetwork(basis_of(name), 3, AdaptiveLaw(ConstantGain(1.0)))
    known = {"mechanics": plant, "parameters": plant.parameters_of()}
    return MetaAdaptive(network, **known, error_gain=1.0, feedback=10.0, drive_gain=10.0)


def flown(name: str, engine: str) -> tuple[mt.ClosedLoop, mt.Trajectory]:
    plant, reference = PlanarQuadrotor(), signal()
    begin = reference(torch.zeros((), dtype=torch.float64))
    scenario = mt.Scenario(
        reference, plant.parameters_of(), T,
        start=mt.PlantState(begin.value, begin.rate),
        disturbance=Disturbance(plant=Polynomial([[6.5]])),
    )  # fmt: skip
    loop = mt.ClosedLoop(plant, controller_of(name), clock=mt.Clock(PERIOD))
    with torch.no_grad():
        run = mt.rollout(
            loop, scenario, mt.RungeKutta(PERIOD / 4),
            sample_dt=PERIOD, sample_until=T, engine=engine,
        )  # fmt: skip
    return loop, run


def commands(loop: mt.ClosedLoop, run: mt.Trajectory) -> Tensor:
    """u (1001, 3): the command of a tick is what is held one sample later, that of T a tick on."""
    q, qd = run.states.plant
    last, rates = run.states.controller.adaptive, run.held.clock.rates.adaptive
    state = run.states.controller
    W = last.network.W[-1]

    def asked(W: Tensor) -> mt.ControlOutput:
        adaptive = last._replace(network=last.network._replace(W=W))
        seen = Measurement(q[-1], qd[-1])
        moved = state._replace(adaptive=adaptive)
        return loop.controller(signal()(run.sample_t[-1]), seen, moved, None)

    ahead = asked(W + PERIOD * rates.network.W[-1]).d_state.adaptive.network.W
    W = W + 0.5 * PERIOD * (rates.network.W[-1] + ahead)
    return torch.cat([run.held.clock.input[1:], asked(W).input.unsqueeze(0)])


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("engine", ["compiled", pytest.param("torch", marks=pytest.mark.slow)])
def test_errors_and_inputs_are_the_published_ones(name: str, engine: str) -> None:
    loop, run = flown(name, engine)
    t, (q, qd), known = run.sample_t, run.states.plant, KNOWN[name]
    assert len(t) == 1001
    wanted = signal()(t)
    e = torch.cat([q - wanted.value, qd - wanted.rate], dim=-1).norm(dim=-1)
    u = commands(loop, run)
    assert abs(float(e.square().mean().sqrt()) / known.rms - 1) <= 1e-4
    assert abs(float(e.max()) / known.peak - 1) <= 1e-4
    assert abs(float(u.square().sum(-1).mean().sqrt()) / known.input - 1) <= 1e-4
    torch.testing.assert_close(q[500], torch.tensor(known.middle).double(), rtol=1e-4, atol=0)
    if name == "pid":
        end = torch.tensor([3.428703, 0.370175, 0.0], dtype=torch.float64)
        torch.testing.assert_close(q[-1], end, rtol=1e-4, atol=1e-6)
