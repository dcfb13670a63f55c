"""L1 norms with closed forms, and what an L1 controller refuses."""

from __future__ import annotations

import math

import pytest
import torch

from mann_torch.control import L1Adaptive, l1_gain, l1_norm
from mann_torch.errors import ConfigError, DomainError, ShapeError


def test_norms_have_their_closed_forms() -> None:
    """1/(s + a): 1/a. exp(-at) sin bt: b coth(pi a / 2b) / (a^2 + b^2), infinitely many signs."""
    assert abs(float(l1_norm([[-0.7]], [[2.0]])) * 0.7 / 2.0 - 1.0) <= 1e-10
    for a, b in ((1.0, 3.0), (0.05, 2.0), (2.0, 0.3)):
        A = [[-a, b], [-b, -a]]
        found = float(l1_norm(A, [[0.0], [1.0]], [[1.0, 0.0]]))
        known = b / math.tanh(0.5 * math.pi * a / b) / (a * a + b * b)
        assert abs(found / known - 1.0) <= 1e-10, (a, b)


def test_the_filter_s_norm_falls_as_its_bandwidth_grows() -> None:
    """Of 1/(s + 1) and 1 - C: h = (w exp(-w t) - exp(-t)) / (w - 1), of integral 0.

    It changes its sign once, where exp((w - 1) t) = w: the norm is twice the integral up to there.
    """
    for w in (5.0, 50.0):
        t = math.log(w) / (w - 1.0)
        known = 2.0 * (math.exp(-t) - math.exp(-w * t)) / (w - 1.0)
        assert abs(float(l1_gain([[-1.0]], [[1.0]], w)) / known - 1.0) <= 1e-10


def test_gradients_reach_the_bandwidth() -> None:
    w = torch.tensor([30.0], dtype=torch.float64, requires_grad=True)
    A, B = [[0.0, 1.0], [-1.0, -1.4]], [[0.0], [1.0]]
    l1_gain(A, B, w).max().backward()
    h = 1e-3
    ends = [float(l1_gain(A, B, 30.0 + x).max()) for x in (h, -h)]
    assert w.grad is not None
    assert abs(float(w.grad) / ((ends[0] - ends[1]) / (2 * h)) - 1.0) <= 1e-6


def test_what_does_not_fit_is_named() -> None:
    stable, b = [[0.0, 1.0], [-1.0, -1.4]], [[0.0], [1.0]]
    with pytest.raises(DomainError, match=r"A_m: its eigenvalues have real parts \[1.0\]"):
        L1Adaptive([[1.0]], [[1.0]])
    with pytest.raises(ConfigError, match="dependent columns"):
        L1Adaptive(stable, [[0.0, 0.0], [1.0, 2.0]])
    with pytest.raises(ConfigError, match="not both"):
        L1Adaptive(stable, b, law=L1Adaptive(stable, b).adaptation.law, period=0.1)
    with pytest.raises(ShapeError, match=r"give \(d, d\) and \(d, m\)"):
        L1Adaptive(stable, [1.0, 2.0])
    with pytest.raises(DomainError, match="bandwidth"):
        l1_gain(stable, b, -1.0)
    with pytest.raises(ConfigError, match="too far apart"):
        l1_norm([[-1.0, 0.0], [0.0, -1e6]], b)
