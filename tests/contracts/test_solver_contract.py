"""What every solver must do. A new one is a line in the list."""

import pytest
import torch

import mann_torch as mt
from mann_torch.simulation import SOLVERS
from tests.conftest import generator, make_loop, make_scenario

# First-order Euler needs smaller inner steps for the same answer.
INNER = {"euler": 2e-5, "implicit_adams": 1e-4}


def make_solver(name: str, dt: float = 5e-3) -> mt.Solver:
    if name == "implicit":
        return mt.Implicit(dt / 5)
    if name == "runge_kutta":
        return mt.RungeKutta(dt / 20)
    rtol = 1e-5 if name == "adaptive_heun" else 1e-7
    return mt.Odeint(name, dt, rtol=rtol, atol=1e-2 * rtol, max_step=INNER.get(name, 2e-4))


@pytest.fixture(scope="module")
def reference() -> torch.Tensor:
    loop, scenario = make_loop("soft"), make_scenario(0.1, jumps=(0.052,))
    with torch.no_grad():
        run = mt.rollout(
            loop, scenario, mt.Odeint("dopri8", 5e-3, 1e-11, 1e-12), generator=generator()
        )
    return run.q[-1]


@pytest.mark.parametrize("name", SOLVERS)
def test_all_solvers_reach_the_same_end(name: str, reference: torch.Tensor) -> None:
    loop, scenario = make_loop("soft"), make_scenario(0.1, jumps=(0.052,))
    with torch.no_grad():
        run = mt.rollout(loop, scenario, make_solver(name), generator=generator())
    assert run.solver == name and run.status.item() == 0
    assert float((run.q[-1] - reference).abs().max()) <= 1e-5


@pytest.mark.parametrize("name", [s for s in SOLVERS if s != "scipy_solver"])
def test_gradients_through_every_solver_match_its_own_differences(name: str) -> None:
    loop, scenario = make_loop("soft"), make_scenario(0.005)
    (gain,) = loop.controller.tune("base_gain")

    def loss() -> torch.Tensor:
        run = mt.rollout(loop, scenario, make_solver(name), generator=generator())
        return run.error.square().sum()

    (gradient,) = torch.autograd.grad(loss(), gain)
    ends = []
    for change in (0.05, -0.05):
        with torch.no_grad():
            gain.add_(change)
            ends.append(float(loss()))
            gain.sub_(change)
    assert float(gradient) == pytest.approx((ends[0] - ends[1]) / 0.1, rel=0.02)


@pytest.mark.parametrize("name", ["dopri5", "rk4"])
def test_a_torchdiffeq_sample_that_fails_does_not_take_the_batch_with_it(name: str) -> None:
    loop, scenario = make_loop("nn"), make_scenario(0.01)
    network = loop.controller.initial_weights((3,), generator())
    W = torch.zeros_like(network.W)
    W[1] = 1e12
    solver = mt.Odeint(name, 5e-3, max_step=2e-4, max_evaluations=300)
    with torch.no_grad():
        run = mt.rollout(loop, scenario, solver, weights=network._replace(W=W))
    assert [s == mt.Status.OK for s in run.status.tolist()] == [True, False, True]


def test_unknown_methods_and_settings_are_named() -> None:
    with pytest.raises(mt.ConfigError, match="method = 'rk5': choose from dopri5"):
        mt.Odeint("rk5")
    with pytest.raises(mt.ConfigError, match="rtol"):
        mt.Odeint("dopri5", rtol=-1.0)
    with pytest.raises(mt.ConfigError, match="max_step"):
        mt.Odeint("rk4", max_step=-1.0)
