"""Physics of the arm."""

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

import mann_torch as mt
from mann_torch.types import PlantState
from tests.conftest import generator, randn


def random_arm(samples: int) -> tuple[mt.TwoLinkArm, mt.ArmParameters, torch.Tensor, torch.Tensor]:
    draw = torch.rand(samples, 4, generator=generator(), dtype=torch.float64)
    parameters = mt.arm_parameters(0.1 + 5 * draw[:, :2], 0.2 + 2 * draw[:, 2:])
    return mt.TwoLinkArm(), parameters, 3 * randn(samples, 2), 5 * randn(samples, 2, seed=1)


def test_mass_matrix_is_symmetric_positive_definite() -> None:
    arm, parameters, q, _ = random_arm(1000)
    M = arm.mass_matrix(q, arm.coefficients(parameters))
    assert torch.equal(M, M.mT)
    assert bool((torch.linalg.eigvalsh(M) > 0).all())


def test_mass_rate_minus_twice_coriolis_is_skew() -> None:
    arm, parameters, q, qd = random_arm(1000)
    c = arm.coefficients(parameters)
    _, rate = torch.func.jvp(lambda x: arm.mass_matrix(x, c), (q,), (qd,))
    S = rate - 2 * arm.coriolis(q, qd, c)
    assert float((S + S.mT).abs().max()) <= 1e-10


def test_load_is_the_gradient_of_potential_energy() -> None:
    arm, parameters, q, _ = random_arm(50)
    c = arm.coefficients(parameters)
    q = q.requires_grad_()
    at_rest = PlantState(q, torch.zeros_like(q))
    (gradient,) = torch.autograd.grad(arm.energy(at_rest, c).sum(), q)
    torch.testing.assert_close(
        arm.load(q, torch.zeros_like(q), c), gradient, rtol=1e-12, atol=1e-12
    )


def test_unforced_arm_keeps_its_energy() -> None:
    arm = mt.TwoLinkArm()
    c = arm.coefficients(mt.arm_parameters())

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        state = PlantState(*torch.from_numpy(y).split(2))
        derivative, _block = arm.derivative(state, torch.zeros(2, dtype=torch.float64), c)
        return torch.cat(derivative).numpy()

    y0 = np.array([0.3, -0.5, 0.2, 0.4])
    solved = solve_ivp(rate, (0, 10), y0, method="DOP853", rtol=1e-12, atol=1e-12)
    energy = [float(arm.energy(PlantState(*torch.from_numpy(y).split(2)), c)) for y in solved.y.T]
    assert max(abs(e - energy[0]) for e in energy) <= 1e-8 * max(map(abs, energy))


def test_viscous_and_coulomb_friction_take_energy_out() -> None:
    arm = mt.TwoLinkArm()
    qd = torch.tensor([0.5, -0.7], dtype=torch.float64)
    q = torch.zeros(2, dtype=torch.float64)
    free = arm.load(q, qd, arm.coefficients(mt.arm_parameters()))
    rough = mt.arm_parameters(viscous=[2.0, 3.0], coulomb=[0.5, 0.4])
    friction = arm.load(q, qd, arm.coefficients(rough)) - free
    # viscous v qd plus Coulomb force against the motion (tanh is 1 at 50 times its velocity)
    expected = torch.tensor([2.0 * 0.5 + 0.5, -3.0 * 0.7 - 0.4], dtype=torch.float64)
    torch.testing.assert_close(friction, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"masses": [-1.0, 2.0]}, "masses"),
        ({"masses": [float("nan"), 2.0]}, "masses"),
        ({"lengths": [0.0, 1.0]}, "lengths"),
        ({"masses": [1.0, 2.0, 3.0]}, "masses"),
        ({"viscous": [-0.1, 0.0]}, "viscous"),
    ],
)
def test_bad_parameters_are_named(change: dict[str, list[float]], word: str) -> None:
    with pytest.raises(mt.ConfigError, match=word):
        mt.arm_parameters(**change)


def test_float32_is_refused() -> None:
    with pytest.raises(mt.ConfigError, match="float64"):
        mt.arm_parameters(masses=torch.ones(2))
