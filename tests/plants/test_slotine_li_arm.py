"""Slotine and Li's arm: its numbers, its linear parameters."""

from __future__ import annotations

import pytest
import torch

from mann_torch.errors import DomainError
from mann_torch.plants import SlotineLiArm, TwoLinkArm, lumped
from tests.conftest import randn
from tests.plants.motion import energy_drift


def test_lumped_parameters_are_the_problems() -> None:
    assert lumped() == pytest.approx((3.34, 0.97, 1.0392305, 0.6), abs=5e-8)
    found = SlotineLiArm().parameters_of().a
    assert found.tolist() == pytest.approx([3.34, 0.97, 1.0392305, 0.6], abs=5e-8)


def test_regressor_times_parameters_is_the_force() -> None:
    arm = SlotineLiArm()
    p = arm.parameters_of(
        a=torch.tensor([3.34, 0.97, 1.04, 0.6]).double() * (1 + 0.1 * randn(50, 1).abs())
    )
    q, qd, v, a = 3 * randn(4, 50, 2)
    force = arm.mass_matrix(q, p) @ a.unsqueeze(-1) + arm.coriolis(q, qd, p) @ v.unsqueeze(-1)
    Y = arm.regressor(q, qd, v, a)
    torch.testing.assert_close(Y @ p.a.unsqueeze(-1), force, rtol=1e-12, atol=1e-11)


def test_regressor_is_the_published_matrix() -> None:
    q, qd, v, w = torch.tensor(
        [[0.3, 0.7], [0.4, -0.5], [1.1, 0.2], [-0.6, 0.9]], dtype=torch.float64
    )
    c2, s2 = torch.cos(q[1]), torch.sin(q[1])
    g = qd[1] * v[0] + qd[0] * v[1] + qd[1] * v[1]
    wide = 2 * w[0] + w[1]
    published = [
        [w[0], w[1], wide * c2 - g * s2, wide * s2 + g * c2],
        [0.0, w[0] + w[1], w[0] * c2 + qd[0] * v[0] * s2, w[0] * s2 - qd[0] * v[0] * c2],
    ]
    found = SlotineLiArm().regressor(q, qd, v, w)
    torch.testing.assert_close(
        found, torch.tensor(published, dtype=torch.float64), rtol=1e-14, atol=1e-14
    )


def test_without_load_angle_it_is_the_two_link_arm_without_gravity() -> None:
    """Point masses at the ends: a = (phi + rho, rho, psi, 0)."""
    two = TwoLinkArm(gravity=0.0)
    c = two.coefficients(two.parameters_of(masses=[0.8, 2.3], lengths=[1.1, 0.7]))
    arm = SlotineLiArm()
    row = lumped(0.8, 1.1, 1.1, 0.0, 2.3, 0.7, 0.0, 0.0)
    p = arm.parameters_of(a=row)
    q, qd = randn(20, 2), randn(20, 2, seed=1)
    torch.testing.assert_close(arm.mass_matrix(q, p), two.mass_matrix(q, c), rtol=0, atol=1e-13)
    torch.testing.assert_close(arm.coriolis(q, qd, p), two.coriolis(q, qd, c), rtol=0, atol=1e-13)


def test_a_free_arm_keeps_its_energy() -> None:
    assert energy_drift(SlotineLiArm(), [0.3, -0.5, 0.7, 0.4], 5.0) <= 1e-9


def test_parameters_of_no_positive_mass_matrix_are_refused() -> None:
    """At the edge M is singular for one q_2; beyond, it is not positive there."""
    arm = SlotineLiArm()
    with pytest.raises(DomainError, match=r"a = .*a_3"):
        arm.parameters_of(a=[3.0, 1.0, 1.0, 1.01])
    arm.parameters_of(a=[3.0, 1.0, 1.0, 0.99])
    bad = arm.Parameters(torch.tensor([3.0, 1.0, 1.0, 1.01], dtype=torch.float64))
    q = torch.tensor([0.0, torch.atan2(torch.tensor(1.01), torch.tensor(1.0))]).double()
    assert float(torch.linalg.eigvalsh(arm.mass_matrix(q, bad)).min()) < 0
