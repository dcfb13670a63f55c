"""Computed torque makes errors linear; what it does not know, robust and integral terms catch."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch.control import BoundaryLayer, ComputedTorque, IntegralAction
from mann_torch.errors import ShapeError
from mann_torch.plants import CartPole, MechanicalPlant, PlanarQuadrotor, TwoLinkArm
from mann_torch.signals import Polynomial, Sinusoid
from mann_torch.types import PlantState


def held(horizon: float, **terms: object) -> mt.Trajectory:
    """At rest, with masses that are thought to be half of what they are: gravity pulls off."""
    arm = TwoLinkArm()
    wrong = arm.parameters_of(masses=0.5 * arm.parameters_of().masses)
    controller = ComputedTorque(arm, wrong, 100.0, 20.0, **terms)  # type: ignore[arg-type]
    name, values = (
        ("integral_gain", [[0.0], [60.0]]) if "integral" in terms else ("sliding_gain", [0.0, 40.0])
    )
    controller.initialize(**{name: values})
    scenario = mt.Scenario(Polynomial([[0.3, 0.2]]), arm.parameters_of(), horizon)
    with torch.no_grad():
        loop = mt.ClosedLoop(arm, controller)
        return mt.rollout(loop, scenario, mt.RungeKutta(2e-3))


@pytest.mark.parametrize("plant", [TwoLinkArm(), PlanarQuadrotor()], ids=lambda p: type(p).__name__)
def test_errors_obey_a_linear_equation(plant: MechanicalPlant) -> None:
    """e'' + 6 e' + 9 e = 0 has e = (e_0 + (e'_0 + 3 e_0) t) exp(-3 t), whatever the plant."""
    if isinstance(plant, PlanarQuadrotor):
        # Air brakes it, which the nominal equations leave out: here there is none.
        known = plant.parameters_of(drag=[0.0, 0.0])
    else:
        known = plant.parameters_of()
    n = plant.n_joints
    controller = ComputedTorque(plant, known, 9.0, 6.0)
    reference = Sinusoid([0.5] * n, 2.0)
    start = PlantState(*(torch.full((n,), x, dtype=torch.float64) for x in (0.2, 0.0)))
    scenario = mt.Scenario(reference, known, 1.5, start=start)
    with torch.no_grad():
        run = mt.rollout(
            mt.ClosedLoop(plant, controller), scenario, mt.RungeKutta(2e-3), engine="torch"
        )
    t = run.t
    first, slope = -0.2, 1.0
    exact = (first + (slope + 3.0 * first) * t) * torch.exp(-3.0 * t)
    torch.testing.assert_close(run.error, exact.unsqueeze(-1).expand(-1, n), rtol=0, atol=1e-8)


def test_integral_action_takes_a_wrong_load_away() -> None:
    run = held(20.0, integral=IntegralAction())
    off, caught = run.error[-1].abs().amax(-1).tolist()
    assert off > 1e-2
    assert caught < 1e-5 * off, (off, caught)


def test_a_robust_term_leaves_less() -> None:
    run = held(2.0, robust=BoundaryLayer(1.0, 0.05))
    off, caught = run.error[-1].abs().amax(-1).tolist()
    assert caught < 0.5 * off, (off, caught)


def test_fewer_inputs_than_coordinates_are_refused() -> None:
    cart = CartPole()
    with pytest.raises(ShapeError, match="CartPole has 1 inputs for 2 coordinates"):
        ComputedTorque(cart, cart.parameters_of())
