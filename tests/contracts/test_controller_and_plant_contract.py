"""Controllers and plants of a user's own work like the library's."""

from typing import NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.trees import map_tensors
from mann_torch.types import (
    ControlOutput,
    Measurement,
    NetworkState,
    PlantState,
    ReferenceSample,
)
from tests.conftest import CONTROLLERS, generator, make_controller, make_scenario, randn


class NoControl(mt.Controller):
    """Zero torque; it has no state."""

    def initial_state(self, reference, measurement, batch_shape, generator=None, weights=None):
        return None, None

    def forward(self, reference, measurement, state, mode):
        return ControlOutput(torch.zeros_like(measurement.q), None, None)


def test_an_unforced_arm_in_a_loop_keeps_its_energy() -> None:
    arm, start = mt.TwoLinkArm(), PlantState(randn(3, 2), randn(3, 2, seed=1))
    scenario = mt.Scenario(mt.Sinusoid([0.0, 0.0]), mt.arm_parameters(), 2.0, start=start)
    loop = mt.ClosedLoop(arm, NoControl())
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.Odeint("dopri8", 0.05, rtol=1e-11, atol=1e-12))
    energy = arm.energy(PlantState(run.q, run.qd), arm.coefficients(scenario.parameters))
    drift = (energy - energy[0]).abs().amax(0) / energy.abs().amax(0)
    assert float(drift.max()) <= 1e-8


class Mass(NamedTuple):
    masses: Tensor  # (..., 3)


class ThreeCarts(mt.MechanicalPlant):
    """Three carts on rails: M = diag(m), no Coriolis force, a spring each."""

    n_joints = 3
    Parameters = Mass

    def coefficients(self, parameters):
        return parameters

    def mass_matrix(self, q, coefficients):
        return torch.diag_embed(coefficients.masses.expand(q.shape))

    def coriolis(self, q, qd, coefficients):
        return torch.zeros(*q.shape, 3, dtype=q.dtype)

    def load(self, q, qd, coefficients):
        return 2.0 * q

    def energy(self, state, coefficients):
        return (0.5 * coefficients.masses * state.qd**2 + state.q**2).sum(-1)


def test_a_plant_with_three_joints_is_controlled() -> None:
    memory = mt.WorkingMemory(3, 6, mt.ReallocatingAttention(), mt.StateKeys(), context_width=3)
    loop = mt.ClosedLoop(ThreeCarts(), mt.MannController(3, 6, memory))
    reference = mt.Sinusoid([1.0, 0.5, -0.5], [0.5, 0.7, 0.9])
    mass = Mass(torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64))
    schedule = {"masses": mt.PiecewiseConstant([1.0], torch.stack([mass.masses, 2 * mass.masses]))}
    scenario = mt.Scenario(reference, mass, 3.0, schedule)
    with torch.no_grad():
        run = mt.rollout(loop, scenario, generator=generator(), batch_shape=(2,))
    assert run.status.tolist() == [0, 0]
    late = run.error[run.t > 2.0].abs().max()
    assert float(late) < 0.05 * float(run.reference.value.abs().max())


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controller_batch_equals_single_calls(name: str) -> None:
    controller = make_controller(name)
    network = controller.initial_weights((4,), generator())
    network = network._replace(W=randn(4, 6, 2))
    reference = ReferenceSample(*randn(3, 4, 2, seed=1))
    seen = Measurement(*randn(2, 4, 2, seed=2))
    state, mode = controller.initial_state(reference, seen, (4,), weights=network)
    torque = controller(reference, seen, state, mode).input
    for i in range(4):
        reference_i = map_tensors(lambda leaf, i=i: leaf[i], reference)
        seen_i = Measurement(*(leaf[i] for leaf in seen))
        state_i, mode_i = controller.initial_state(
            reference_i, seen_i, (), weights=NetworkState(*(leaf[i] for leaf in network))
        )
        one = controller(reference_i, seen_i, state_i, mode_i).input
        torch.testing.assert_close(one, torque[i], rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_constants_may_differ_per_sample(name: str) -> None:
    scenario = make_scenario(0.2)
    values = {"base_gain": [10.0, 30.0], "rate_W": [5.0, 20.0]}
    if name != "nn":
        values["write_gain"] = [0.5, 1.5]
    together = make_controller(name)
    together.initialize(**values)
    network = together.initial_weights((2,), generator())
    both = mt.rollout(mt.ClosedLoop(mt.TwoLinkArm(), together), scenario, weights=network)
    for i in range(2):
        alone = make_controller(name)
        alone.initialize(**{key: value[i] for key, value in values.items()})
        one = NetworkState(*(leaf[i] for leaf in network))
        run = mt.rollout(mt.ClosedLoop(mt.TwoLinkArm(), alone), scenario, weights=one)
        torch.testing.assert_close(run.q, both.q[:, i], rtol=0, atol=1e-12)
