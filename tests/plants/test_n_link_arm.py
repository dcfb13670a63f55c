"""The arm of n links against the two-link arm and Lagrange's equations.

MuJoCo's equations: tests/simulators/test_arm_mjcf.py.
"""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from mann_torch.errors import ConfigError, DomainError
from mann_torch.plants import NLinkArm, NLinkParameters, TwoLinkArm
from mann_torch.types import PlantState
from tests.conftest import generator, randn
from tests.plants.motion import energy_drift


def random_arm(n: int, samples: int = 50) -> tuple[NLinkArm, NLinkParameters, Tensor, Tensor]:
    arm = NLinkArm(n)
    draw = torch.rand(6, samples, n, generator=generator(), dtype=torch.float64)
    low = torch.tensor([0.2, 0.3, -0.2, 0.0, 0.0, 0.0], dtype=torch.float64)
    wide = torch.tensor([2.0, 1.0, 1.2, 0.3, 0.0, 0.0], dtype=torch.float64)
    rows = (low[:, None, None] + wide[:, None, None] * draw).unbind(0)
    parameters = arm.parameters_of(**dict(zip(NLinkParameters._fields, rows, strict=True)))
    return arm, parameters, 3 * randn(samples, n), 4 * randn(samples, n, seed=1)


def test_two_links_are_the_two_link_arm() -> None:
    friction = {"viscous": [0.3, 0.2], "coulomb": [0.5, 0.1]}
    body = {"masses": [0.8, 2.3], "lengths": [1.0, 0.7]}
    many, two = NLinkArm(2), TwoLinkArm()
    c, d = (arm.coefficients(arm.parameters_of(**body, **friction)) for arm in (many, two))
    q, qd = 3 * randn(200, 2), 5 * randn(200, 2, seed=1)
    for found, known in (
        (many.mass_matrix(q, c), two.mass_matrix(q, d)),
        (many.coriolis(q, qd, c), two.coriolis(q, qd, d)),
        (many.load(q, qd, c), two.load(q, qd, d)),
        (many.energy(PlantState(q, qd), c), two.energy(PlantState(q, qd), d)),
    ):
        assert float((found - known).abs().max()) <= 1e-12 * max(1.0, float(known.abs().max()))
    slope, known_slope = many.load_slope(q, qd, c), two.load_slope(q, qd, d)
    assert slope is not None and known_slope is not None
    torch.testing.assert_close(slope, known_slope, rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_mass_matrix_and_coriolis(n: int) -> None:
    arm, parameters, q, qd = random_arm(n)
    c = arm.coefficients(parameters)
    M = arm.mass_matrix(q, c)
    torch.testing.assert_close(M, M.mT, rtol=0.0, atol=1e-13)
    assert bool((torch.linalg.eigvalsh(M) > 0).all())
    _, rate = torch.func.jvp(lambda x: arm.mass_matrix(x, c), (q,), (qd,))
    S = rate - 2 * arm.coriolis(q, qd, c)
    assert float((S + S.mT).abs().max()) <= 1e-12 * max(1.0, float(rate.abs().max()))


def test_forces_are_lagranges_of_the_links_positions() -> None:
    """T and P from where the masses are, without any of the plant's matrices."""
    n = 3
    arm, parameters, q, qd = random_arm(n, 1)
    masses, lengths, centers, inertias = (row[0] for row in parameters[:4])
    q, qd = q[0], qd[0]

    def places(x: Tensor) -> Tensor:
        theta = x.cumsum(-1)
        along = torch.stack([torch.cos(theta), torch.sin(theta)], dim=-1)
        ends = (lengths.unsqueeze(-1) * along).cumsum(0)
        return torch.cat([torch.zeros(1, 2).double(), ends[:-1]]) + (
            (centers * lengths).unsqueeze(-1) * along
        )

    def lagrangian(x: Tensor, v: Tensor) -> Tensor:
        _, speeds = torch.func.jvp(places, (x,), (v,))
        kinetic = 0.5 * (masses * speeds.square().sum(-1)).sum()
        turning = 0.5 * (inertias * v.cumsum(-1).square()).sum()
        return kinetic + turning - 9.8 * (masses * places(x)[:, 1]).sum()

    acceleration = randn(n, seed=3)
    momentum = lambda x, v: torch.func.grad(lagrangian, 1)(x, v)  # noqa: E731
    _, rate = torch.func.jvp(momentum, (q, qd), (qd, acceleration))
    owed = rate - torch.func.grad(lagrangian, 0)(q, qd)
    c = arm.coefficients(NLinkParameters(*(row[0] for row in parameters)))
    found = arm.mass_matrix(q, c) @ acceleration + arm.coriolis(q, qd, c) @ qd
    torch.testing.assert_close(found + arm.load(q, qd, c), owed, rtol=1e-11, atol=1e-11)


def test_a_free_arm_keeps_its_energy() -> None:
    arm = NLinkArm(3)
    body = {"centers": [0.5, 0.4, 0.6], "inertias": [0.1, 0.05, 0.02]}
    assert energy_drift(arm, [0.3, -0.5, 0.2, 0.4, 0.1, -0.6], 4.0, **body) <= 1e-9


def test_a_last_link_without_inertia_is_refused() -> None:
    arm = NLinkArm(2)
    with pytest.raises(DomainError, match="last link"):
        arm.parameters_of(centers=[1.0, 0.0])
    with pytest.raises(DomainError, match="inertias"):
        arm.parameters_of(inertias=[-1.0, 0.0])
    arm.parameters_of(centers=[1.0, 0.0], inertias=[0.0, 0.1])  # a wheel
    with pytest.raises(ConfigError, match="n_joints"):
        NLinkArm(0)
