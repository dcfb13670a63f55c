"""Problem 7 (Karason and Annaswamy 1994): an unstable plant whose input is limited."""

from __future__ import annotations

import math

import pytest
import torch

import mann_torch as mt
from mann_torch import control
from mann_torch.plants import LinearPlant
from mann_torch.plants.first_order import RowState
from mann_torch.signals import Sinusoid

LIMIT = 10.0
MODEL, INPUT = [[-1.0]], [[1.0]]
PARTS = {
    "unprotected": lambda limit: None,
    "augmented error": lambda limit: control.AugmentedError(MODEL, INPUT, limit),
    "hedging": lambda limit: control.Hedging(MODEL, INPUT, limit),
    "known limits": lambda limit: control.KnownLimits(limit),
    "mu-modification": lambda limit: control.MuModification(MODEL, INPUT, limit, 2.0, 1.0),
}
PROTECTED = [name for name in PARTS if name != "unprotected"]


def each_of(*names: str) -> pytest.MarkDecorator:
    """All of them; each is a loop to compile, so the last alone is quick."""
    slow = [pytest.param(name, marks=pytest.mark.slow) for name in names[:-1]]
    return pytest.mark.parametrize("name", [*slow, names[-1]])


def limited(
    name: str,
    *parts: control.LawPart,
    start: float = -9.99,
    horizon: float = 10.0,
    known_limit: float = LIMIT,
    dt: float = 2e-3,
    engine: str = "compiled",
    gains: tuple[float, float] = (-2.2, 1.1),
    model_start: float = -9.9,
) -> mt.Trajectory:
    """x' = x + sat(u), u = theta x + k r, after x_m' = -x_m + r."""
    plant = LinearPlant([[1.0]], [[1.0]], [[1.0]])
    law = control.AdaptiveLaw(control.ConstantGain(0.1), *parts)
    network = control.LinearNetwork(control.Identity(2), 1, law, start=[[gains[0]], [gains[1]]])
    controller = control.Mrac.of_model(
        MODEL, INPUT, network, Q=2.0, saturation=PARTS[name](known_limit)
    )
    loop = mt.ClosedLoop(
        plant,
        controller,
        actuator=mt.Actuator(1, limit=LIMIT),
        model=mt.LinearModel.first_order(1.0, start=model_start),
    )
    scenario = mt.Scenario(
        Sinusoid([5.0], 0.5),
        plant.parameters_of(),
        horizon,
        start=RowState(torch.tensor([start], dtype=torch.float64)),
    )
    with torch.no_grad():
        return mt.rollout(loop, scenario, mt.RungeKutta(dt), sample_dt=0.5, engine=engine)


def found_at(run: mt.Trajectory, k: int) -> list[float]:
    """x, theta and k at a sample, each half second."""
    gains = run.states.controller.adaptive.network.W[k, :, 0].tolist()
    return [float(run.states.plant.x[k]), *gains]


def test_the_augmented_error_keeps_the_gains() -> None:
    found = found_at(limited("augmented error"), 20)
    assert found == pytest.approx([-4.50622, -2.16608, 1.11085], abs=5.1e-6)


def test_unprotected_they_wind_up() -> None:
    run = limited("unprotected")
    thetas = [found_at(run, k)[1] for k in (10, 20)]
    assert thetas == pytest.approx([-52.973, -62.471], abs=5.1e-4)


@each_of("unprotected", *PROTECTED)
def test_from_beyond_what_is_controllable_no_law_comes_back(name: str) -> None:
    """u = 10 to the end: x = -10 - 0.01 e^t, which is -100 at log(9000) = 9.105 s."""
    run = limited(name, start=-10.01, horizon=9.2)
    first = int((run.output[:, 0] <= -100.0).nonzero()[0])
    assert float(run.t[first]) - 2e-3 < math.log(9000.0) <= float(run.t[first])
    closed = -10.0 - 0.01 * torch.exp(run.t)
    torch.testing.assert_close(run.output[:, 0], closed, rtol=1e-9, atol=0)


@each_of(*PROTECTED)
def test_limits_that_are_never_met_change_nothing(name: str) -> None:
    """Bit for bit: what is known of the limits, not the limits, is what counts."""
    run, plain = limited(name, known_limit=1e6), limited("unprotected")
    assert torch.equal(run.output, plain.output)
    assert found_at(run, 20) == found_at(plain, 20)


@pytest.mark.slow
def test_hedging_takes_all_of_the_limits_out_of_the_error() -> None:
    """With the ideal gains nothing is to be learned, however long the input is at its limit."""
    run = limited("hedging", start=-6.0, gains=(-2.0, 1.0), model_start=-6.0)
    assert found_at(run, 20)[1:] == pytest.approx([-2.0, 1.0], abs=1e-12)
    assert float(run.error.abs().max()) > 0.1


def test_what_is_frozen_stands_still_while_the_input_is_cut() -> None:
    """Until x is back from the edge, x = -10 + 0.01 e^t; unprotected, theta is -62.471 at 10 s."""
    run = limited("known limits", control.FreezeWhileSaturated(), start=-9.99)
    assert found_at(run, 10)[1:] == [-2.2, 1.1]
    assert 0.0 < abs(found_at(run, 20)[1] + 2.2) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["augmented error", "unprotected"])
def test_the_torch_engine_finds_the_same(name: str) -> None:
    known = {"augmented error": -2.16608, "unprotected": -62.471}
    found = found_at(limited(name, engine="torch"), 20)[1]
    assert found == pytest.approx(known[name], abs=5.1e-4 if name == "unprotected" else 5.1e-6)
