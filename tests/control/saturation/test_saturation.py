"""What is asked of an input that is limited, and what it lacks."""

from __future__ import annotations

import pytest
import torch

from mann_torch import control
from mann_torch.errors import DomainError, ShapeError
from tests.conftest import randn

A, B, LIMIT = [[-1.0, 0.5], [0.0, -2.0]], [[1.0, 0.0], [0.5, 1.0]], [1.0, 2.0]


def test_mu_modification_solves_its_equation() -> None:
    """u_c = u + mu (L sat(u_c / L) - u_c): Lavretsky and Hovakimyan's own form is implicit."""
    part = control.MuModification(A, B, LIMIT, mu=3.0, limit_margin=0.25)
    wanted = 3.0 * randn(200, 2)
    asked = part.command(wanted)
    inner = torch.tensor(LIMIT, dtype=torch.float64) - 0.25
    bound = torch.maximum(torch.minimum(asked, inner), -inner)
    torch.testing.assert_close(asked, wanted + 3.0 * (bound - asked), rtol=0, atol=1e-12)
    assert bool((wanted.abs() > inner).any()) and bool((wanted.abs() <= inner).any())


def test_its_slope_is_the_derivative() -> None:
    part = control.MuModification(A, B, LIMIT, mu=3.0, limit_margin=0.25)
    wanted = (3.0 * randn(50, 2)).requires_grad_()
    (slope,) = torch.autograd.grad(part.command(wanted).sum(), wanted)
    torch.testing.assert_close(slope, part.slope(wanted), rtol=0, atol=0)


def test_without_mu_it_is_the_augmented_error_bit_for_bit() -> None:
    plain = control.AugmentedError(A, B, LIMIT, deficit_rate=0.7)
    other = control.MuModification(A, B, LIMIT, mu=0.0, limit_margin=0.25, deficit_rate=0.7)
    wanted = 3.0 * randn(50, 2)
    assert torch.equal(other.command(wanted), wanted)
    assert torch.equal(other.excess(wanted), plain.excess(wanted))


def test_an_excess_is_what_the_limits_cut_off() -> None:
    part = control.Hedging(A, B, LIMIT)
    found = part.excess(torch.tensor([[0.5, -5.0], [3.0, 2.0]], dtype=torch.float64))
    assert found.tolist() == [[0.0, 3.0], [-2.0, 0.0]]


def test_a_known_effect_is_a_learned_one_that_is_right() -> None:
    """Augmented error from beta = 1 at a rate of 0 is hedging."""
    hedging = control.Hedging(A, B, LIMIT)
    learned = control.AugmentedError(A, B, LIMIT, deficit_rate=0.0, start=1.0)
    e_d, drive, excess = randn(4, 2), randn(4, 2, seed=1), randn(4, 2, seed=2)
    kept = learned.initial_state((4,))._replace(e_d=e_d)
    moved = learned.rates(kept, drive, excess)
    plain = hedging.rates(hedging.initial_state((4,))._replace(e_d=e_d), drive, excess)
    assert torch.equal(moved.e_d, plain.e_d) and not moved.effect.any()
    matrices = [torch.tensor(rows, dtype=torch.float64) for rows in (A, B)]
    expected = e_d @ matrices[0].mT + excess @ matrices[1].mT
    torch.testing.assert_close(plain.e_d, expected, rtol=0, atol=1e-14)


def test_what_is_impossible_is_named() -> None:
    with pytest.raises(DomainError, match="the margin must be less than"):
        control.MuModification(A, B, LIMIT, limit_margin=1.0)
    with pytest.raises(DomainError, match="input_limit"):
        control.Hedging(A, B, [1.0, 0.0])
    with pytest.raises(ShapeError, match=r"A of shape \(2, 1\): give a matrix"):
        control.Hedging([[1.0], [1.0]], B, LIMIT)
    with pytest.raises(ShapeError, match="start of shape"):
        control.AugmentedError(A, B, LIMIT, start=[1.0, 1.0, 1.0])
    network = control.LinearNetwork(control.Identity(3), 2)
    with pytest.raises(ShapeError, match="saturation of 2 inputs and 2 states in a controller of"):
        control.Mrac([[1.0], [1.0]], network, saturation=control.Hedging(A, B, LIMIT))
