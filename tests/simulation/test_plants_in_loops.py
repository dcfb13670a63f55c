"""Every plant of the library in a loop: the engines agree, and agree with SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from torch import Tensor

import mann_torch as mt
from mann_torch.control import LinearFeedback
from mann_torch.plants import PlanarQuadrotor, Plant
from mann_torch.signals import Disturbance, Sinusoid
from mann_torch.trees import Packer, leaves
from tests.contracts.test_plant_contract import OTHER_PARAMETERS, PLANTS_TO_CHECK


def proportional(plant: Plant, parameters: Any) -> LinearFeedback:
    """u = H r - G y, with some gains for any plant."""
    seen = plant.measure(plant.rest(), plant.coefficients(parameters))
    width = sum(leaf.shape[-1] for leaf in leaves(seen))
    m, p = len(plant.inputs), len(plant.outputs)
    numbers = torch.arange(m * max(width, p), dtype=torch.float64)
    G = 0.5 * torch.sin(1.0 + numbers[: m * width]).reshape(m, width)
    return LinearFeedback(G, torch.cos(numbers[: m * p]).reshape(m, p))


def setting(name: str) -> tuple[mt.ClosedLoop, mt.Scenario]:
    plant = PLANTS_TO_CHECK[name]()
    parameters = plant.parameters_of(**OTHER_PARAMETERS.get(name, {}))
    reference = Sinusoid([1.0] * len(plant.outputs), 0.7, 0.2)
    loop = mt.ClosedLoop(plant, proportional(plant, parameters))
    return loop, mt.Scenario(reference, parameters, 0.5)


def final(run: mt.Trajectory) -> Tensor:
    """The plant's numbers at the end."""
    return torch.cat([leaf[-1] for leaf in leaves(run.states.plant)], dim=-1)


def by_scipy(name: str) -> np.ndarray:
    """The same loop, its plant alone taken from the library."""
    loop, scenario = setting(name)
    plant, c = loop.plant, loop.plant.coefficients(scenario.parameters)
    packer: Packer[Any] = Packer(plant.rest(), 0)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        time, state = torch.tensor(t, dtype=torch.float64), packer.unpack(torch.from_numpy(y))
        seen = plant.measure(state, c)
        u = loop.controller(scenario.reference(time), seen, None, None).input
        return packer.pack(plant.derivative(time, state, plant.grouped(u), None, c)).numpy()

    start = packer.pack(plant.rest()).numpy()
    return solve_ivp(rate, (0.0, 0.5), start, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]


def check_engines(name: str) -> None:
    with torch.no_grad():
        ends = {
            (engine, dt): final(mt.rollout(*setting(name), mt.Implicit(dt), engine=engine))
            for engine, dt in (("torch", 0.004), ("compiled", 0.004), ("compiled", 0.001))
        }
        known = torch.from_numpy(by_scipy(name))
    coarse, fine = ends["compiled", 0.004], ends["compiled", 0.001]
    scale = max(1.0, float(known.abs().max()))
    assert float((ends["torch", 0.004] - coarse).abs().max()) <= 1e-12 * scale
    errors = [float((end - known).abs().max()) / scale for end in (coarse, fine)]
    # Order 2: a sixteenth for a quarter of the step, but for what SciPy's digits hide.
    assert errors[1] <= 1e-4 and errors[1] <= max(errors[0] / 10.0, 1e-9)


def gradient(name: str, engine: str) -> Tensor:
    """Of the plant's end by all its parameters."""
    loop, scenario = setting(name)
    rows = [row.clone().requires_grad_() for row in scenario.parameters]
    scenario = mt.Scenario(scenario.reference, type(scenario.parameters)(*rows), 0.2)
    end = final(mt.rollout(loop, scenario, mt.Implicit(0.004), engine=engine))
    found = torch.autograd.grad(end.square().sum(), rows, materialize_grads=True)
    return torch.cat(found)


@pytest.mark.parametrize("name", ["flexible_joint_arm", "planar_quadrotor", "rohrs", "wing_rock"])
def test_engines_agree_with_each_other_and_with_scipy(name: str) -> None:
    check_engines(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS_TO_CHECK)
def test_engines_agree_for_every_plant(name: str) -> None:
    check_engines(name)
    by_torch, compiled = (gradient(name, engine) for engine in ("torch", "compiled"))
    assert float((by_torch - compiled).abs().max()) <= 1e-12 * float(by_torch.abs().max())
    assert float(by_torch.abs().max()) > 1e-4


def test_gradients_of_both_engines_agree() -> None:
    by_torch, compiled = (gradient("n_link_arm", engine) for engine in ("torch", "compiled"))
    torch.testing.assert_close(by_torch, compiled, rtol=1e-11, atol=1e-12)


def test_wind_reaches_the_quadrotor() -> None:
    """In the compiled loop, against the problem's equations in NumPy."""
    plant = PlanarQuadrotor()
    controller = proportional(plant, plant.parameters_of())
    reference = Sinusoid([1.0, 0.5, 0.2], 0.7)
    wind = Disturbance(plant=Sinusoid([2.0], 1.3, 6.5))
    scenario = mt.Scenario(reference, plant.parameters_of(), 1.0, disturbance=wind)
    with torch.no_grad():
        run = mt.rollout(mt.ClosedLoop(plant, controller), scenario, mt.Implicit(0.001))
    G, H = controller.feedback.reshape(3, 6).numpy(), controller.feedforward.reshape(3, 3).numpy()

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, v = y[:3], y[3:]
        cos, sin = np.cos(q[2]), np.sin(q[2])
        u = H @ (np.array([1.0, 0.5, 0.2]) * np.sin(0.7 * t)) - G @ y
        B = np.array([[-sin, 0.0, cos], [cos, 0.0, sin], [0.0, 1.0, 0.0]])
        R = np.array([[cos, -sin], [sin, cos]])
        through = R.T @ (v[:2] - np.array([6.5 + 2.0 * np.sin(1.3 * t), 0.0]))
        drag = R @ (np.array([0.1, 1.0]) * through * np.abs(through))
        return np.concatenate([v, B @ u - np.array([0.0, 9.81, 0.0]) - np.append(drag, 0.0)])

    known = solve_ivp(rate, (0.0, 1.0), np.zeros(6), "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(final(run).numpy(), known, rtol=0, atol=1e-5)
    assert abs(known[0]) > 0.5  # the wind has carried it
