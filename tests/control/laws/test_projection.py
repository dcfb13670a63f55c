"""The smooth projection does what Lavretsky and Gibson prove of it."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from mann_torch.control import AdaptiveLaw, ConstantGain, Drive, GainInForce, Projection

N, BOUND, MARGIN = 4, 2.0, 0.1
#: Where what is sought may lie: f <= 0.
INNER = BOUND / (1.0 + MARGIN) ** 0.5


def randn(*shape: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def matrix() -> Tensor:
    half = randn(N, N, seed=7)
    return half @ half.mT + 0.05 * torch.eye(N, dtype=torch.float64)


def points() -> tuple[Tensor, Tensor, Tensor]:
    """theta anywhere within the bound, many near it, theta* where f <= 0, and any rate."""
    directions = [torch.nn.functional.normalize(randn(20000, N, 1, seed=k), dim=-2) for k in (0, 1)]
    sizes = torch.rand(2, 20000, 1, 1, generator=torch.Generator().manual_seed(2)).double()
    theta = directions[0] * BOUND * sizes[0].pow(0.1)
    sought = directions[1] * INNER * sizes[1].pow(0.25)
    return theta, sought, randn(20000, N, 1, seed=3)


@pytest.mark.parametrize(
    "gamma", [torch.tensor(3.0).double(), torch.tensor([0.5, 1.0, 2.0, 9.0]).double(), matrix()]
)
def test_it_never_works_against_the_parameters(gamma: Tensor) -> None:
    """(theta - theta*)' Gamma^-1 (Proj(y) - y) <= 0 at every point, 0 within the inner ball."""
    theta, sought, y = points()
    gain = ConstantGain(gamma)
    change = Projection(BOUND, MARGIN)(y, theta, GainInForce(gain, None)) - y
    whole = gain.applied(torch.eye(N, dtype=torch.float64), None)
    if whole.shape != (N, N):
        whole = whole.expand(N, N)
    away = theta - sought
    slope = (away * torch.linalg.solve(whole, change)).sum(dim=(-2, -1))
    assert float(slope.max()) <= 1e-12
    outside = theta.norm(dim=(-2, -1)) > INNER
    assert bool((slope[outside] < -1e-6).any()) and not bool(change[~outside].any())
    # In the Euclidean metric it is so of a multiple of I alone.
    plain = float((away * change).sum(dim=(-2, -1)).max())
    assert plain <= 1e-12 if gamma.dim() == 0 else plain > 1e-3


def test_on_the_bound_no_rate_leads_outwards() -> None:
    theta, _, y = points()
    theta = BOUND * torch.nn.functional.normalize(theta, dim=-2)
    for gain in (ConstantGain(3.0), ConstantGain([0.5, 1.0, 2.0, 9.0]), ConstantGain(matrix())):
        rate = Projection(BOUND, MARGIN)(gain.applied(y, None), theta, GainInForce(gain, None))
        outward = (theta * rate).sum(dim=(-2, -1))
        assert float(outward.max()) <= 1e-12 and float(outward.min()) < -1.0


def test_the_norm_never_passes_its_bound() -> None:
    """Pushed outwards: every column comes to its bound, of any gain, and stays there."""
    gains = [3.0 * torch.eye(N).double(), torch.diag(torch.tensor([0.5, 1.0, 2.0, 9.0]).double())]
    law = AdaptiveLaw(ConstantGain(gains[0]), Projection(BOUND, MARGIN))
    law.initialize(adaptation_rate=torch.stack([*gains, matrix()]).unsqueeze(1))
    phi, s = randn(6, N, seed=4), randn(6, 3, seed=5)
    drive = Drive.of_features(phi, 5.0 * s, s.norm(dim=-1))
    theta, h, largest = torch.zeros(3, 6, N, 3, dtype=torch.float64), 1e-3, []

    def rate(x: Tensor) -> Tensor:
        return law(drive, x, None)[0]

    for _ in range(3000):
        k_1 = rate(theta)
        k_2 = rate(theta + h / 2 * k_1)
        k_3 = rate(theta + h / 2 * k_2)
        theta = theta + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + rate(theta + h * k_3))
        largest.append(theta.norm(dim=-2))
    norms = torch.stack(largest)
    assert float(norms.max()) <= BOUND * (1.0 + 1e-9)  # the method's own error
    assert float((norms[-1] > 0.99 * BOUND).double().mean()) > 0.9
    # Without a guard it would be far outside.
    free = AdaptiveLaw(law.gain)(drive, theta, None)[0]
    assert float((3.0 * free).norm(dim=-2).median()) > 5.0 * BOUND
