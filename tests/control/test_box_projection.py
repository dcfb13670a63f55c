"""Projection into a box: where it leads, and Lyapunov's inequality."""

from __future__ import annotations

import torch

from mann_torch.control import AdaptiveLaw, BoxProjection, ConstantGain, Drive
from tests.conftest import generator

BOUND, MARGIN = 2.0, 0.2


def rates(law: AdaptiveLaw, estimate: torch.Tensor, drive: torch.Tensor) -> torch.Tensor:
    """Of theta (..., N, 1) under Phi s = drive, entry by entry."""
    phi = torch.diag_embed(torch.ones_like(drive))
    given = Drive(phi, drive.unsqueeze(-1), torch.zeros_like(drive[..., 0]))
    found: torch.Tensor = law(given, estimate, None)[0]
    return found


def test_it_leads_no_estimate_out_and_is_lyapunov_s_friend() -> None:
    """(theta^ - theta*)' Gamma^-1 (Proj(y) - y) <= 0 for every theta* that the box's core holds."""
    g, gains = generator(3), torch.tensor([1.0, 3.0, 0.5], dtype=torch.float64)
    law = AdaptiveLaw(ConstantGain(gains), BoxProjection(BOUND, MARGIN))
    free = AdaptiveLaw(ConstantGain(gains))
    core = BOUND / (1.0 + MARGIN) ** 0.5
    estimate = BOUND * (2.0 * torch.rand(4000, 3, 1, generator=g, dtype=torch.float64) - 1.0)
    sought = core * (2.0 * torch.rand(4000, 3, 1, generator=g, dtype=torch.float64) - 1.0)
    drive = torch.randn(4000, 3, generator=g, dtype=torch.float64)
    cut = rates(law, estimate, drive) - rates(free, estimate, drive)
    toward = (estimate - sought) * cut / gains.unsqueeze(-1)
    assert float(toward.max()) <= 0.0
    touched = (cut != 0).any(-1).any(-1)
    assert 0.1 < float(touched.double().mean()) < 0.9
    # Each on its own: what is within the core moves as if there were no others.
    assert torch.equal(cut[estimate.abs() <= core], torch.zeros_like(cut[estimate.abs() <= core]))
    on_rim = torch.full((2, 3, 1), BOUND, dtype=torch.float64)
    on_rim[1] *= -1.0
    push = torch.ones(2, 3, dtype=torch.float64)
    push[1] *= -1.0
    torch.testing.assert_close(rates(law, on_rim, push), torch.zeros(2, 3, 1).double())
