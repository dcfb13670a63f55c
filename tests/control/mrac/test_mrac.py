"""State MRAC: its equations, of several inputs too, and what it refuses."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control
from mann_torch.control.lyapunov import lyapunov
from mann_torch.errors import ConfigError, DomainError, ShapeError
from mann_torch.plants import LinearPlant, RowState
from mann_torch.signals import Disturbance, Polynomial, Sinusoids
from tests.conftest import randn

#: x' = (A_m - B W*') x + B u: two inputs, coupled.
MODEL, INPUT = [[-1.0, 0.5], [0.0, -2.0]], [[1.0, 0.0], [0.5, 1.0]]
OFF = [[0.5, -1.0], [-0.8, 0.3]]  # theta* (2, 2) of x, a column an input
AHEAD = [[1.0, 0.2], [0.0, 1.0]]  # of r, known
RATE, Q = 3.0, [[2.0, 0.3], [0.3, 1.0]]


def matrices() -> tuple[Tensor, Tensor, Tensor, Tensor]:
    A, B, W, K = (torch.tensor(rows, dtype=torch.float64) for rows in (MODEL, INPUT, OFF, AHEAD))
    return A, B, W, K


def first_two(z: Tensor) -> Tensor:
    return z[..., :2]


def coupled(**parts: Any) -> control.Mrac:
    law = control.AdaptiveLaw(control.ConstantGain(RATE))
    network = control.LinearNetwork(control.FunctionBasis(first_two, 4, 2), 2, law)
    return control.Mrac.of_model(MODEL, INPUT, network, Q=Q, feedforward=AHEAD, **parts)


def run(
    controller: control.Mrac, disturbance: Disturbance | None = None, horizon: float = 10.0
) -> mt.Trajectory:
    A, B, W, K = matrices()
    plant = LinearPlant(A - B @ W.mT, INPUT, torch.eye(2).double(), measured="state")
    model = mt.LinearModel(A, B @ K)
    signal = Sinusoids([[1.0, 0.5]], 1.0)
    scenario = mt.Scenario(signal, plant.parameters_of(), horizon, disturbance=disturbance)
    loop = mt.ClosedLoop(plant, controller, model=model)
    with torch.no_grad():
        return mt.rollout(loop, scenario, mt.RungeKutta(5e-3), sample_dt=5e-3)


def test_the_energy_of_two_coupled_inputs_falls_as_it_should() -> None:
    """V = e'P e + tr(W~'W~) / rate, V' = -e'Q e: a matrix of estimates, and E = B'P."""
    found = run(coupled())
    A, _, W, _ = matrices()
    weight = torch.tensor(Q, dtype=torch.float64)
    e = found.states.model - found.states.plant.x
    off = found.states.controller.adaptive.network.W - W
    V = (e @ lyapunov(A, weight) * e).sum(-1) + off.square().sum((-2, -1)) / RATE
    spent = (e @ weight * e).sum(-1)
    simpson = 5e-3 / 3 * (spent[:-1:2] + 4 * spent[1::2] + spent[2::2]).sum()
    assert float(V[-1]) < 0.8 * float(V[0])
    assert float(V[0] - V[-1]) == pytest.approx(float(simpson), abs=1e-8)


@pytest.mark.parametrize("n", [1, 3])
def test_the_lyapunov_equation_is_solved(n: int) -> None:
    A = randn(n, n) - 3.0 * n * torch.eye(n, dtype=torch.float64)
    Q = torch.eye(n, dtype=torch.float64) + randn(n, n, seed=1) @ randn(n, n, seed=1).mT
    P = lyapunov(A, Q)
    torch.testing.assert_close(A.mT @ P + P @ A, -Q, rtol=0, atol=1e-13)
    assert bool((torch.linalg.eigvalsh(P) > 0).all())


def asked(state: Any, controller: control.Mrac, x: Tensor) -> mt.ControlOutput:
    reference = mt.ReferenceSample(
        randn(6, 2), command=randn(6, 2, seed=3), state=randn(6, 2, seed=4)
    )
    start, mode = controller.initial_state(reference, RowState(x), (6,))
    state = start if state is None else state
    return controller(reference, RowState(x), state, mode)


def test_its_gains_are_the_inputs_derivative() -> None:
    made = coupled(
        feedback=randn(2, 2, seed=5),
        error_feedback=[[0.5, 0.0], [0.1, 0.4]],
        integral=control.IntegralAction(0.5),
        saturation=control.MuModification(MODEL, INPUT, 2.0, 2.0, 0.1),
    )
    made.network.start.copy_(randn(2, 2, seed=6))
    x = randn(6, 2, seed=7)
    out = asked(None, made, x)
    state, _ = made.initial_state(
        mt.ReferenceSample(randn(6, 2), command=randn(6, 2), state=randn(6, 2)), RowState(x), (6,)
    )
    full = torch.func.jacrev(lambda x: asked(state, made, x).input)(x)
    own = torch.stack([full[i, :, i] for i in range(6)])
    found = made.input_gains(mt.ReferenceSample(randn(6, 2)), out, state)
    # The features' slope is not known of a function: what is known is counted.
    slope = torch.func.jacrev(lambda z: made.network.basis(z))(randn(4))[:, :2]
    inner = made.saturation.slope(out.signals.wanted).unsqueeze(-1)
    expected = -own + inner * (made.network.start.mT @ slope)
    torch.testing.assert_close(found.measurement, expected, rtol=0, atol=1e-12)
    assert bool((inner < 1.0).any()) and bool((inner == 1.0).any())


def test_integral_action_takes_a_constant_offset_away() -> None:
    """Without adaptation, a constant push on each input: the integral ends as its opposite."""
    push = [0.4, -0.3]
    made = coupled(integral=control.IntegralAction(4.0), feedback=(-matrices()[2].mT).tolist())
    made.initialize(adaptation_rate=0.0)
    found = run(made, Disturbance(input=Polynomial([push])), 60.0)
    assert float(found.error[-1].abs().max()) < 1e-6
    kept = 4.0 * found.states.controller.integral[-1]
    assert kept.tolist() == pytest.approx([-0.4, 0.3], abs=1e-5)


def test_what_does_not_go_together_is_named() -> None:
    network = control.LinearNetwork(control.Identity(3), 1)
    with pytest.raises(DomainError, match=r"A: its eigenvalues have real parts \[-1.0, 1.0\]"):
        control.Mrac.of_model([[0.0, 1.0], [1.0, 0.0]], [[0.0], [1.0]], network)
    with pytest.raises(ShapeError, match=r"A of shape \(1, 2\)"):
        control.Mrac.of_model([[0.0, 1.0]], [[1.0]], network)
    with pytest.raises(ShapeError, match="Q of shape"):
        control.Mrac.of_model([[-1.0]], [[1.0]], network, Q=[1.0, 2.0])
    with pytest.raises(ShapeError, match="give n \\+ p > 3 inputs and 1 outputs"):
        control.Mrac([[1.0, 1.0, 1.0]], network)
    with pytest.raises(ShapeError, match=r"feedback of shape \(1, 1\): give a matrix"):
        control.Mrac([[1.0, 1.0]], network, feedback=[[1.0]])
    made = control.Mrac([[1.0, 1.0]], network)
    with pytest.raises(ShapeError, match="2 inputs and 1 outputs got MRAC of 1 inputs"):
        made.check_fit(2, 1)
    with pytest.raises(ConfigError, match="Mrac follows a reference model"):
        made.initial_state(mt.ReferenceSample(randn(1)), RowState(randn(2)), ())
    sample = mt.ReferenceSample(randn(1), command=randn(1), state=randn(3))
    with pytest.raises(ShapeError, match="of 3 states and 1 commands got Mrac of 2 states and 1"):
        made.initial_state(sample, RowState(randn(2)), ())
    with pytest.raises(ShapeError, match="error_gain of 2 states: 3 are measured"):
        made.initial_state(sample, RowState(randn(3)), ())
