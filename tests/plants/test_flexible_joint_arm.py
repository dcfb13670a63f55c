"""Links behind springs: energy, the rigid arm as the limit, and what stiff springs need."""

from __future__ import annotations

import numpy as np
import torch

from mann_torch.plants import FlexibleJointArm, NLinkArm
from mann_torch.stiff import SecondOrderBlock
from mann_torch.types import InputGains, PlantState
from tests.conftest import randn
from tests.plants.motion import energy_drift, moved

BODY = {"masses": [0.8, 2.3], "viscous": [0.3, 0.2]}


def test_a_free_arm_keeps_its_energy_and_motor_friction_takes_it() -> None:
    arm, start = FlexibleJointArm(), [0.3, -0.5, 0.2, -0.4, 0.4, 0.1, -0.6, 0.2]
    assert energy_drift(arm, start, 3.0, stiffness=[80.0, 120.0]) <= 1e-9
    parameters = arm.parameters_of(motor_friction=[0.5, 0.8])
    states = moved(arm, parameters, start, np.linspace(0.0, 3.0, 61))
    energy = arm.energy(states, arm.coefficients(parameters))
    assert bool((energy.diff() < 0).all())


def test_equations_are_spongs() -> None:
    """Written out for links and motors, with the arm of stiff joints for M, C and N."""
    arm, links = FlexibleJointArm(), NLinkArm(2)
    K, J, Bm = [90.0, 60.0], [0.7, 0.4], [0.5, 0.3]
    c = arm.coefficients(arm.parameters_of(**BODY, stiffness=K, motor_inertia=J, motor_friction=Bm))
    d = links.coefficients(links.parameters_of(**BODY))
    q, qd, tau = randn(20, 4), randn(20, 4, seed=1), randn(20, 2, seed=2)
    t = torch.zeros(20, dtype=torch.float64)
    rate = arm.derivative(t, PlantState(q, qd), arm.grouped(tau), None, c)
    ql, qm, vl, vm = q[:, :2], q[:, 2:], qd[:, :2], qd[:, 2:]
    spring = torch.tensor(K, dtype=torch.float64) * (qm - ql)
    on_links = spring - (links.coriolis(ql, vl, d) @ vl.unsqueeze(-1))[..., 0]
    on_links = on_links - links.load(ql, vl, d)
    al = torch.linalg.solve(links.mass_matrix(ql, d), on_links.unsqueeze(-1))[..., 0]
    am = (tau - torch.tensor(Bm, dtype=torch.float64) * vm - spring) / torch.tensor(
        J, dtype=torch.float64
    )
    torch.testing.assert_close(rate.qd, torch.cat([al, am], dim=-1), rtol=1e-11, atol=1e-11)
    assert torch.equal(rate.q, qd)


def test_stiff_springs_are_the_rigid_arm_with_the_motors_inertia_added() -> None:
    """The gap shrinks as 1/K: a tenth for ten times the stiffness."""
    times, start = np.linspace(0.0, 0.5, 6), [0.3, -0.5]
    M_J = 0.5

    class Rigid(NLinkArm):
        def mass_matrix(self, q, coefficients):
            return super().mass_matrix(q, coefficients) + M_J * torch.eye(2, dtype=torch.float64)

    rigid = Rigid(2)
    known = moved(rigid, rigid.parameters_of(**BODY), [*start, 0.0, 0.0], times).q
    arm, gaps = FlexibleJointArm(), []
    for stiffness in (1e4, 1e5):
        parameters = arm.parameters_of(**BODY, stiffness=[stiffness] * 2, motor_inertia=[M_J] * 2)
        # Springs begin where gravity holds them: no ringing.
        links = arm.links
        still = torch.zeros(2, dtype=torch.float64)
        c = arm.coefficients(parameters)
        q0 = torch.tensor(start, dtype=torch.float64)
        rigid_c = rigid.coefficients(rigid.parameters_of(**BODY))
        qdd = torch.linalg.solve(rigid.mass_matrix(q0, rigid_c), -rigid.load(q0, still, rigid_c))
        pull = links.mass_matrix(q0, c.links) @ qdd + links.load(q0, still, c.links)
        motors = (q0 + pull / stiffness).tolist()
        found = moved(arm, parameters, [*start, *motors, *[0.0] * 4], times, max_step=0.01)
        gaps.append(float((found.q[:, :2] - known).abs().max()))
    assert gaps[0] < 1e-2
    assert 0.05 < gaps[1] / gaps[0] < 0.2


def test_what_is_measured_and_what_follows() -> None:
    q, qd = randn(3, 4), randn(3, 4, seed=1)
    state = PlantState(q, qd)
    for measured, part in (("motors", slice(2, 4)), ("links", slice(0, 2)), ("all", slice(0, 4))):
        arm = FlexibleJointArm(measured=measured)
        c = arm.coefficients(arm.parameters_of())
        seen = arm.measure(state, c)
        assert torch.equal(seen.q, q[:, part]) and torch.equal(seen.qd, qd[:, part])
        assert torch.equal(arm.output(state, c), q[:, :2])


def test_the_stiff_block_is_the_jacobian_of_springs_motors_and_gains() -> None:
    """At rest and without gravity nothing is left out of it."""
    arm = FlexibleJointArm(gravity=0.0)
    c = arm.coefficients(arm.parameters_of(**BODY, stiffness=[1e4, 2e4], motor_friction=[3.0, 4.0]))
    q, gain = torch.tensor([0.3, -0.2, 0.3, -0.2], dtype=torch.float64), randn(2, 4)
    t, still = torch.zeros((), dtype=torch.float64), torch.zeros(4, dtype=torch.float64)
    held = arm.grouped(torch.zeros(2, dtype=torch.float64))

    q_0 = q

    def acceleration(q: torch.Tensor, qd: torch.Tensor) -> torch.Tensor:
        state = PlantState(q, qd)
        seen = torch.cat(arm.measure(state, c))
        here = torch.cat(arm.measure(PlantState(q_0, still), c))
        tau = arm.grouped(held.torque - gain @ (seen - here))
        return arm.derivative(t, state, tau, None, c).qd

    by_q, by_qd = torch.func.jacrev(acceleration, (0, 1))(q, still)
    gains = InputGains(gain, torch.zeros(2, dtype=torch.float64))
    _, block = arm.linearized(t, PlantState(q, still), held, None, c, gains)
    assert isinstance(block, SecondOrderBlock)
    torch.testing.assert_close(-block.stiffness, by_q, rtol=1e-10, atol=1e-8)
    torch.testing.assert_close(-block.damping, by_qd, rtol=1e-10, atol=1e-8)


def test_an_implicit_step_over_stiff_springs_takes_energy_an_explicit_one_adds() -> None:
    """Rates of 1e4/s in steps of 0.01 s."""
    arm = FlexibleJointArm(gravity=0.0)
    c = arm.coefficients(arm.parameters_of(stiffness=[1e8] * 2))
    t, tau = torch.zeros((), dtype=torch.float64), arm.grouped(torch.zeros(2).double())
    h = torch.full((1,), 0.01, dtype=torch.float64)
    state = torch.cat([0.1 * randn(4), torch.zeros(4, dtype=torch.float64)])
    energies = [float(arm.energy(PlantState(*state.split(4)), c))]
    first = torch.cat(arm.derivative(t, PlantState(*state.split(4)), tau, None, c))
    explicit = state + h * first
    for _ in range(20):
        rate, block = arm.linearized(t, PlantState(*state.split(4)), tau, None, c, None)
        assert block is not None
        state = state + h * block.damped(torch.cat(rate), h, 0.0)
        energies.append(float(arm.energy(PlantState(*state.split(4)), c)))
    assert max(energies[1:]) < 0.01 * energies[0]
    assert float(arm.energy(PlantState(*explicit.split(4)), c)) > 100 * energies[0]
