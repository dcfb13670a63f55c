"""Linear plants: transfer functions, exact steps, the loop's block."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from scipy.linalg import expm

from mann_torch.errors import ConfigError, DomainError, KindError, ShapeError
from mann_torch.plants import LinearPlant, RowState, controllable_form
from mann_torch.stiff import FirstOrderBlock
from mann_torch.types import InputGains
from tests.conftest import randn
from tests.plants.motion import moved


def response(plant: LinearPlant, frequency: float) -> complex:
    """C (j w I - A)^-1 B."""
    A, B, C = (x.numpy() for x in plant.coefficients(plant.parameters_of()))
    return complex((C @ np.linalg.solve(1j * frequency * np.eye(len(A)) - A, B + 0j))[0, 0])


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([2.0], [1.0, 1.0]),
        ([458.0], [1.0, 31.0, 259.0, 229.0]),
        ([3.0, 1.0, 5.0], [2.0, 0.7, 4.0, 0.3]),
        ([0.0, 1.0, 0.0], [1.0, 0.2, 1.0, 0.0, 0.0]),
    ],
)
def test_frequency_response_is_the_transfer_functions(
    numerator: list[float], denominator: list[float]
) -> None:
    plant = LinearPlant.from_transfer_function(numerator, denominator)
    for frequency in np.logspace(-3, 4, 71):
        s = 1j * frequency
        known = np.polyval(numerator, s) / np.polyval(denominator, s)
        assert abs(response(plant, frequency) - known) <= 1e-10 * abs(known)


def test_motion_is_the_matrix_exponentials() -> None:
    """Under a constant input, from the exponential of [[A, B u], [0, 0]]."""
    A, B = randn(4, 4), randn(4, 2, seed=1)
    plant = LinearPlant(A, B, torch.eye(4, dtype=torch.float64), measured="state")
    start, u, times = randn(4, seed=2), randn(2, seed=3), np.linspace(0.0, 2.0, 5)
    found = moved(plant, plant.parameters_of(), start.tolist(), times, lambda t: u.tolist()).x
    block = np.zeros((5, 5))
    block[:4, :4], block[:4, 4] = A.numpy(), (B @ u).numpy()
    for t, x in zip(times, found, strict=True):
        known = (expm(block * t) @ np.append(start.numpy(), 1.0))[:4]
        np.testing.assert_allclose(x.numpy(), known, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("measured", ["output", "state"])
def test_the_block_is_the_loops_jacobian(measured: str) -> None:
    A, B, C = randn(3, 3), randn(3, 2, seed=1), randn(2, 3, seed=2)
    plant = LinearPlant(A, B, C, measured)
    c, state = plant.coefficients(plant.parameters_of()), RowState(randn(3, seed=3))
    seen = 2 if measured == "output" else 3
    gains = InputGains(randn(2, seen, seed=4), randn(2, seed=5))
    t, zero = torch.zeros((), dtype=torch.float64), torch.zeros(2, dtype=torch.float64)

    def rate(x: torch.Tensor, time: torch.Tensor) -> torch.Tensor:
        (measurement,) = plant.measure(RowState(x), c)
        u = gains.drift * time - gains.measurement @ measurement
        return plant.derivative(time, RowState(x), plant.grouped(u), None, c).x

    by_x, by_t = torch.func.jacrev(rate, (0, 1))(state.x, t)
    _, block = plant.linearized(t, state, plant.grouped(zero), None, c, gains)
    torch.testing.assert_close(block.jacobian, by_x, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(block.drift, by_t, rtol=1e-12, atol=1e-12)
    _, alone = plant.linearized(t, state, plant.grouped(zero), None, c, None)
    assert isinstance(alone, FirstOrderBlock) and torch.equal(alone.jacobian, A)


def test_matrices_may_differ_by_sample_and_carry_gradients() -> None:
    plant = LinearPlant([[-1.0]], [[0.5]], [[1.0]])
    rates = torch.tensor([[-1.0], [-3.0]], dtype=torch.float64, requires_grad=True)
    c = plant.coefficients(plant.parameters_of(A=rates))
    x = torch.tensor([[2.0], [2.0]], dtype=torch.float64)
    u = plant.grouped(torch.ones(2, 1, dtype=torch.float64))
    rate = plant.derivative(torch.zeros(2).double(), RowState(x), u, None, c).x
    assert rate.tolist() == [[-1.5], [-5.5]]
    (gradient,) = torch.autograd.grad(rate.sum(), rates)
    assert gradient.tolist() == [[2.0], [2.0]]


def test_controllable_form_is_controllable_and_normalised() -> None:
    A, B, C = controllable_form([4.0, 2.0], [2.0, 6.0, 8.0])
    assert A.tolist() == [[0.0, 1.0], [-4.0, -3.0]]
    assert B.tolist() == [[0.0], [1.0]] and C.tolist() == [[1.0, 2.0]]
    reach = torch.cat([B, A @ B], dim=-1)
    assert int(torch.linalg.matrix_rank(reach)) == 2


@pytest.mark.parametrize(
    ("numerator", "denominator", "said", "error"),
    [
        ([1.0, 0.0], [1.0, 1.0], "not strictly proper", ConfigError),
        (
            [1.0, 0.0, 0.0],
            [1.0, 1.0],
            "numerator has degree 2 and denominator degree 1",
            ConfigError,
        ),
        ([0.0], [1.0, 1.0], "numerator", ConfigError),
        ([1.0], [0.0, 0.0], "denominator", ConfigError),
        ([1.0], [1.0, float("nan")], "denominator", DomainError),
        ([[1.0]], [1.0, 1.0], "numerator", ShapeError),
        ("1", [1.0, 1.0], "numerator", KindError),
    ],
)
def test_what_is_no_plant_is_refused(
    numerator: Any, denominator: Any, said: str, error: type[Exception]
) -> None:
    with pytest.raises(error, match=said):
        LinearPlant.from_transfer_function(numerator, denominator)


@pytest.mark.parametrize(
    ("A", "B", "C", "said"),
    [
        ([[1.0, 2.0]], [[1.0]], [[1.0]], "A has shape"),
        ([[1.0]], [[1.0], [2.0]], [[1.0]], "B has shape"),
        ([[1.0]], [[1.0]], [[1.0, 2.0]], "C has shape"),
        ([1.0], [[1.0]], [[1.0]], "A has shape.*matrix"),
    ],
)
def test_matrices_that_do_not_go_together_are_named(A: Any, B: Any, C: Any, said: str) -> None:
    with pytest.raises(ShapeError, match=said):
        LinearPlant(A, B, C)
