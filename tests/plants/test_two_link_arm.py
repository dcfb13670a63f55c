"""Physics of the arm."""

import pytest
import torch

from mann_torch.errors import ConfigError
from mann_torch.plants import ArmParameters, TwoLinkArm, arm_parameters
from mann_torch.types import PlantState
from tests.conftest import generator, randn
from tests.plants.motion import energy_drift


def random_arm(samples: int) -> tuple[TwoLinkArm, ArmParameters, torch.Tensor, torch.Tensor]:
    draw = torch.rand(samples, 4, generator=generator(), dtype=torch.float64)
    parameters = arm_parameters(0.1 + 5 * draw[:, :2], 0.2 + 2 * draw[:, 2:])
    return TwoLinkArm(), parameters, 3 * randn(samples, 2), 5 * randn(samples, 2, seed=1)


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
    assert energy_drift(TwoLinkArm(), [0.3, -0.5, 0.2, 0.4], 10.0) <= 1e-8


def test_viscous_and_coulomb_friction_take_energy_out() -> None:
    arm = TwoLinkArm()
    qd = torch.tensor([0.5, -0.7], dtype=torch.float64)
    q = torch.zeros(2, dtype=torch.float64)
    free = arm.load(q, qd, arm.coefficients(arm_parameters()))
    rough = arm_parameters(viscous=[2.0, 3.0], coulomb=[0.5, 0.4])
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
    with pytest.raises(ConfigError, match=word):
        arm_parameters(**change)


def test_float32_is_refused() -> None:
    with pytest.raises(ConfigError, match="float64"):
        arm_parameters(masses=torch.ones(2))
