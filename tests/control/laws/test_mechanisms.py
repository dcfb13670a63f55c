"""What each mechanism does to a rate, at a point."""

from __future__ import annotations

import torch
from torch import Tensor

from mann_torch.control import (
    AdaptiveLaw,
    Composite,
    ConcurrentLearning,
    ConstantGain,
    DeadZone,
    Drive,
    LeastSquares,
    Normalisation,
    Pair,
    SwitchingSigma,
)
from mann_torch.control.laws.adaptive import Beside, LawState
from mann_torch.control.laws.concurrent_learning import Stack, Watch
from mann_torch.control.laws.least_squares import Covariance

B, N, R, M = 5, 4, 2, 3


def randn(*shape: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


PHI, ERROR, THETA = randn(B, N, R, seed=0), randn(B, R, M, seed=1), randn(B, N, M, seed=2)
DRIVE = Drive(PHI, ERROR, ERROR.norm(dim=(-2, -1)))
SILENT = DRIVE._replace(error=torch.zeros_like(ERROR))


def test_a_dead_zone_leaves_what_is_beyond_it() -> None:
    left = DeadZone(0.5)(DRIVE).error
    assert torch.equal(left, ERROR - ERROR.clamp(-0.5, 0.5))
    assert bool((left == 0).any()) and bool((left > 0).any()) and bool((left < 0).any())


def test_normalisation_divides_by_what_the_regressor_weighs() -> None:
    weights = torch.tensor([0.5, 0.0, 1.0, 2.0], dtype=torch.float64)
    size = 1.0 + torch.einsum("bir,i,bir->b", PHI, weights, PHI)
    left = Normalisation(weights)(DRIVE).error
    torch.testing.assert_close(left, ERROR / size[:, None, None], rtol=1e-14, atol=0)
    # However large a regressor, it pushes by |Phi| |s| / nu |Phi|^2 at most.
    huge = DRIVE._replace(regressor=1e6 * PHI)
    pushed = AdaptiveLaw(Normalisation(1.0))(huge, THETA, None)[0]
    assert float(pushed.norm(dim=(-2, -1)).max()) < 1e-5


def test_switching_sigma_pulls_at_large_columns_alone() -> None:
    size = torch.tensor([0.5, 1.0, 1.5, 2.0, 7.0], dtype=torch.float64)[:, None, None]
    theta = 3.0 * size * THETA / THETA.norm(dim=-2, keepdim=True)
    rate = AdaptiveLaw(ConstantGain(2.0), SwitchingSigma(0.4, 3.0))(SILENT, theta, None)[0]
    share = torch.tensor([0.0, 0.0, 0.5, 1.0, 1.0], dtype=torch.float64)[:, None, None]
    torch.testing.assert_close(rate, -2.0 * 0.4 * share * theta, rtol=1e-12, atol=1e-14)
    still = torch.zeros_like(theta).requires_grad_()
    SwitchingSigma(0.4, 3.0)(SILENT, still).sum().backward()
    assert still.grad is not None and not bool(still.grad.any())


def test_composite_is_the_gradient_law_of_the_pairs_own_error() -> None:
    label = randn(B, R, M, seed=3)
    drive = SILENT._replace(pair=Pair(PHI, label))
    missed = DRIVE._replace(error=label - PHI.mT @ THETA)
    for gain in (ConstantGain(2.0), ConstantGain([1.0, 0.5, 2.0, 0.0])):
        found = AdaptiveLaw(gain, Composite(1.0))(drive, THETA, None)[0]
        known = AdaptiveLaw(gain)(missed, THETA, None)[0]
        torch.testing.assert_close(found, known, rtol=1e-13, atol=1e-14)


def test_a_recorded_stack_does_what_a_frozen_one_does() -> None:
    points, labels = randn(6, N, seed=4), randn(6, M, seed=5)
    gain = ConstantGain(torch.diag(torch.tensor([1.0, 2.0, 0.5, 3.0], dtype=torch.float64)))
    frozen = AdaptiveLaw(gain, ConcurrentLearning(0.3, points=points, labels=labels))
    known = (
        0.3
        * torch.diag(torch.tensor([1.0, 2.0, 0.5, 3.0]).double())
        @ (points.mT @ (labels - points @ THETA))
    )
    torch.testing.assert_close(frozen(SILENT, THETA, None)[0], known, rtol=1e-12, atol=1e-13)
    stack = Stack(
        points.unsqueeze(-1).expand(B, 6, N, 1), labels.unsqueeze(-2).expand(B, 6, 1, M),
        torch.full((B,), 6),
    )  # fmt: skip
    kept = LawState(None, Beside(Watch(torch.zeros(B, dtype=torch.float64)), None))
    mode = LawState(None, Beside(stack, None))
    found = AdaptiveLaw(gain, ConcurrentLearning(0.3, 6))(SILENT, THETA, kept, mode)[0]
    torch.testing.assert_close(found, known, rtol=1e-12, atol=1e-13)


def test_a_bounded_gain_grows_to_its_bound_and_no_further() -> None:
    """Without excitation p' = lambda p (1 - p/k) of p = |P|: the logistic law."""
    law = LeastSquares(0.5, forgetting=2.0, gain_bound=8.0)
    quiet = DRIVE._replace(regressor=torch.zeros_like(PHI))
    state, h = law.initial_state(N, M, (B,)), 1e-3

    def rate(P: Tensor) -> Tensor:
        return law.rates(quiet, Covariance(P)).P

    P = state.P
    for _ in range(4000):
        k_1 = rate(P)
        k_2 = rate(P + h / 2 * k_1)
        k_3 = rate(P + h / 2 * k_2)
        P = P + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + rate(P + h * k_3))
    grown = torch.exp(torch.tensor(-2.0 * 4.0, dtype=torch.float64))
    known = 8.0 / (1.0 + (8.0 / 1.0 - 1.0) * grown)  # |P(0)| = 0.5 sqrt(4)
    torch.testing.assert_close(P.norm(dim=(-2, -1)), known.expand(B), rtol=1e-9, atol=0)
    # With excitation it grows less still: at the bound |P| can but fall.
    at_bound = 8.0 * P / P.norm(dim=(-2, -1), keepdim=True)
    falls = (at_bound * law.rates(DRIVE, Covariance(at_bound)).P).sum(dim=(-2, -1))
    assert bool((falls < 0).all())


def test_a_gain_is_divided_with_what_it_is_driven_by() -> None:
    """P' = -P Phi Phi' P/m^2 and theta' = P Phi s/m^2, m^2 = 1 + nu tr(Phi' Phi)."""
    half = randn(N, N, seed=6)
    P = (half @ half.mT + torch.eye(N)).expand(B, N, N)
    law, state = LeastSquares(1.0, gain_normalisation=0.7), Covariance(P)
    size = (1.0 + 0.7 * PHI.square().sum(dim=(-2, -1)))[:, None, None]
    torch.testing.assert_close(law.drive(DRIVE, state), P @ PHI @ ERROR / size)
    torch.testing.assert_close(law.rates(DRIVE, state).P, -P @ PHI @ PHI.mT @ P / size)
