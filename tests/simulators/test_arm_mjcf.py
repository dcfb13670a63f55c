"""Arms in MuJoCo's format: the same equations, to the last digits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.plants import NLinkArm, Pendulum, TwoLinkArm
from mann_torch.simulators import arm_mjcf, arm_payloads
from mann_torch.trees import map_tensors
from tests.conftest import generator, randn
from tests.plants.test_n_link_arm import random_arm

mujoco = pytest.importorskip("mujoco", reason="an extra: pip install mann_torch[simulators]")


def of_mujoco(text: str, q: Any, qd: Any) -> tuple[Any, Any, Any]:
    """Mass matrix, bias forces and passive forces that MuJoCo has at q, qd."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q.numpy(), qd.numpy()
    mujoco.mj_forward(model, data)
    mass = np.zeros((len(q), len(q)))
    for column, unit in zip(mass, np.eye(len(q)), strict=True):  # symmetric: rows are columns
        mujoco.mj_mulM(model, data, column, unit)
    return mass, data.qfrc_bias, data.qfrc_passive


def agree(plant: Any, parameters: Any, q: torch.Tensor, qd: torch.Tensor) -> None:
    for i in range(len(q)):
        own = map_tensors(lambda row, i=i: row[i], parameters)
        mass, bias, passive = of_mujoco(arm_mjcf(plant, own), q[i], qd[i])
        c = plant.coefficients(own)
        np.testing.assert_allclose(plant.mass_matrix(q[i], c).numpy(), mass, rtol=0, atol=1e-10)
        load = plant.load(q[i], qd[i], c) - own.viscous * qd[i]
        forces = plant.coriolis(q[i], qd[i], c) @ qd[i] + load
        np.testing.assert_allclose(forces.numpy(), bias, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(passive, -(own.viscous * qd[i]).numpy(), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_links_have_the_plants_mass_matrix_and_bias_forces(n: int) -> None:
    arm, parameters, q, qd = random_arm(n, 20)
    viscous = torch.rand(20, n, generator=generator(2), dtype=torch.float64)
    agree(arm, parameters._replace(viscous=viscous), q, qd)


def test_so_has_the_papers_arm() -> None:
    draws = 0.3 + 2.5 * torch.rand(3, 50, 2, generator=generator(), dtype=torch.float64)
    none = torch.zeros_like(draws[0])
    parameters = mt.arm_parameters(*draws, coulomb=none)
    agree(TwoLinkArm(9.81), parameters, 3 * randn(50, 2), 5 * randn(50, 2, seed=1))


def test_a_schedule_becomes_payloads() -> None:
    masses = mt.PiecewiseConstant([1.0, 2.5], [[1.0, 1.0], [1.0, 3.0], [2.0, 1.0]])
    arm = NLinkArm(2)
    body = arm.parameters_of(inertias=[0.1, 0.2])
    scenario = mt.Scenario(mt.Sinusoid([1.0, 0.0]), body, 5.0, schedule={"masses": masses})
    rows = arm_payloads(arm, scenario)
    assert [(row.t, row.body, row.mass) for row in rows] == [
        (1.0, "link_1", 1.0), (1.0, "link_2", 3.0), (2.5, "link_1", 2.0), (2.5, "link_2", 1.0),
    ]  # fmt: skip
    assert [row.inertia for row in rows[:2]] == [(0.1,) * 3, (0.2,) * 3]


def test_what_is_no_arm_is_refused() -> None:
    with pytest.raises(mt.ConfigError, match="plant = Pendulum: a TwoLinkArm or an NLinkArm"):
        arm_mjcf(Pendulum())
    with pytest.raises(mt.ShapeError, match=r"parameters of batch shape \(3,\)"):
        arm_mjcf(TwoLinkArm(), mt.arm_parameters(masses=[[1.0, 1.0]] * 3))
    with pytest.raises(mt.ConfigError, match="integrator = 'heun': choose from Euler, RK4"):
        arm_mjcf(TwoLinkArm(), integrator="heun")
    lengths = mt.PiecewiseConstant([1.0], [[1.0, 1.0], [1.0, 2.0]])
    longer = mt.Scenario(
        mt.Sinusoid([1.0, 0.0]), mt.arm_parameters(), 5.0, schedule={"lengths": lengths}
    )
    with pytest.raises(mt.ConfigError, match="only masses and inertias change"):
        arm_payloads(TwoLinkArm(), longer)
