"""A closed-loop reference model (Gibson et al., arXiv 1304.7278), of one state."""

from __future__ import annotations

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control
from mann_torch.plants import LinearPlant
from mann_torch.signals import Sinusoid

#: x' = x + u after x_m' = -x_m + r + l (x - x_m): u = -2 x + r is ideal.
IDEAL = (-2.0, 1.0)
GAINS = [[0.0], [2.0], [8.0]]


def run(rate: float, gains: tuple[float, float], start: float) -> mt.Trajectory:
    plant = LinearPlant([[1.0]], [[1.0]], [[1.0]])
    law = control.AdaptiveLaw(control.ConstantGain(rate))
    network = control.LinearNetwork(control.Identity(2), 1, law, start=[[k] for k in gains])
    model = mt.LinearModel([[-1.0]], [[1.0]], observer_gain=[[0.0]], start=[start])
    model.initialize(observer_gain=GAINS)
    loop = mt.ClosedLoop(plant, control.Mrac([[1.0]], network), model=model)
    scenario = mt.Scenario(Sinusoid([1.0], 1.0), plant.parameters_of(), 10.0)
    with torch.no_grad():
        return mt.rollout(loop, scenario, mt.RungeKutta(2e-3), sample_dt=10.0)


def test_its_error_decays_faster() -> None:
    """With the ideal gains, e = e(0) exp((a_m - l) t)."""
    found = run(0.0, IDEAL, 2.0)
    rates = -1.0 - torch.tensor(GAINS, dtype=torch.float64)[:, 0]
    closed = 2.0 * torch.exp(rates * found.t.unsqueeze(-1))
    torch.testing.assert_close(found.error[..., 0], closed, rtol=0, atol=1e-9)


def test_it_takes_the_peaks_off_the_error_and_the_swing_off_the_gains() -> None:
    """The larger l, the smaller max |e| and the integral of |d theta/dt|^2."""
    found = run(50.0, (0.0, 0.0), 0.0)
    e, x = found.error[..., 0], found.output[..., 0]
    r = torch.sin(found.t).unsqueeze(-1)
    speed = (50.0 * e).square() * (x.square() + r.square())

    def falls(values: Tensor) -> bool:
        return bool((values.diff() < 0).all())

    assert falls(e.abs().amax(dim=0))
    assert falls(torch.trapezoid(speed, found.t, dim=0))
