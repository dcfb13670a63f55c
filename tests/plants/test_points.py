"""Where a mechanism's points are: masses there have the plant's own energy."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from mann_torch.plants import (
    CartPole,
    DoubleIntegrator,
    FlexibleJointArm,
    NLinkArm,
    Pendulum,
    PlanarQuadrotor,
    TwoLinkArm,
)
from mann_torch.types import PlantState
from tests.conftest import randn

ARM = {"masses": [0.8, 2.3, 0.4], "lengths": [1.0, 0.7, 0.5]}
#: A plant of point masses, its parameters, and how much is at each of its points [kg].
MASSES: dict[str, tuple[Any, dict[str, Any], list[float]]] = {
    "two links": (TwoLinkArm(), {n: row[:2] for n, row in ARM.items()}, [0.0, 0.8, 2.3]),
    "three links": (NLinkArm(3), ARM, [0.0, *ARM["masses"]]),
    "cart and pole": (CartPole(), {"cart": [1.2], "pole": [0.3], "length": [0.6]}, [1.2, 0.3]),
    "pendulum": (Pendulum(), {"mass": [1.7], "length": [0.4]}, [0.0, 1.7]),
    "quadrotor": (PlanarQuadrotor(), {}, [1.0]),
}


@pytest.mark.parametrize("case", MASSES)
def test_masses_at_the_points_have_the_plants_energy(case: str) -> None:
    plant, values, masses = MASSES[case]
    parameters = plant.parameters_of(**values)
    coefficients = plant.coefficients(parameters)
    q, qd = 2 * randn(50, plant.n_joints), 3 * randn(50, plant.n_joints, seed=1)
    if case == "quadrotor":  # its pitch has an inertia of its own
        qd = qd * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
    weights = torch.tensor(masses, dtype=torch.float64)
    points, speeds = torch.func.jvp(lambda x: plant.points(x, parameters), (q,), (qd,))
    assert points.shape == (50, len(masses), 2)
    gravity = getattr(plant, "gravity", 9.81)
    kinetic = 0.5 * (weights * speeds.square().sum(-1)).sum(-1)
    found = kinetic + gravity * (weights * points[..., 1]).sum(-1)
    energy: Tensor = plant.energy(PlantState(q, qd), coefficients)
    lowest = 1.7 * 0.4 * gravity if case == "pendulum" else 0.0  # which counts from there
    torch.testing.assert_close(found + lowest, energy, rtol=1e-12, atol=1e-12)


def test_flexible_joints_turn_the_same_links() -> None:
    soft, rigid = FlexibleJointArm(3), NLinkArm(3)
    q = randn(20, 6)
    found = soft.points(q, soft.parameters_of(**ARM))
    known = rigid.points(q[:, :3], rigid.parameters_of(**ARM))
    torch.testing.assert_close(found, known, rtol=0.0, atol=0.0)


def test_what_has_no_shape_says_so() -> None:
    plant = DoubleIntegrator(2)
    with pytest.raises(NotImplementedError, match="DoubleIntegrator has no shape"):
        plant.points(randn(2), plant.parameters_of())
