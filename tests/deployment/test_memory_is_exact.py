"""What a deployed memory writes is the write law's exponential, at any period."""

from __future__ import annotations

from fractions import Fraction

import pytest
import torch

import mann_torch as mt
from mann_torch.functional import second_mean
from mann_torch.types import MemoryState


def numbers(*given: float) -> torch.Tensor:
    return torch.tensor(given, dtype=torch.float64)


@pytest.mark.parametrize("rule", [mt.RepresentationKeys(), mt.StateKeys(3.0)])
@pytest.mark.parametrize("period", [1e-3, 0.1, 2.0])
def test_contents_and_keys_relax_as_the_law_says(rule: mt.KeyRule, period: float) -> None:
    """W = 0 and an error of 0: features stand still, and mu -> c_w sigma as e^-t."""
    q, width = numbers(0.3, -0.2), rule.width(2)
    memory = mt.WorkingMemory(1, 4, mt.HardAttention(), rule, context_width=2)
    first = numbers(3.0, 3.0, 3.0, 3.0)[None]
    memory.store_(MemoryState(first, torch.ones(1, width, dtype=torch.float64)))
    stepper = mt.deploy(mt.MannController(2, 4, memory), period, engine="torch")
    row = torch.cat([q, torch.zeros(4).double()]), torch.cat([q, torch.zeros(2).double()])
    state = stepper.initial_state(*row)
    for _ in range(4):
        _, state = stepper(state, *row)
    kept = stepper.unpacked(state).controller
    still = torch.zeros(4, dtype=torch.float64)
    features = torch.sigmoid(torch.cat([still, q, still]) @ kept.network.V + kept.network.b_v)
    gone = torch.exp(numbers(-3.0 * period))  # three periods: before the first tick there is none
    target = 0.75 * features
    close = {"rtol": 1e-12, "atol": 1e-13}
    torch.testing.assert_close(kept.memory.mu[0], target + (3.0 - target) * gone, **close)
    wanted = q[:width] + (1.0 - q[:width]) * gone**3.0
    torch.testing.assert_close(kept.memory.keys[0], wanted, **close)


def test_the_second_mean() -> None:
    """Against the sum of (-z)^k / (k + 2)! in fractions, and for large z against its limit."""
    z = numbers(0.0, 1e-9, 1e-3, 0.2499, 0.25, 1.0, 30.0, 1e4)
    exact = []
    for each in z.tolist():
        x, term, total = Fraction(each), Fraction(1, 2), Fraction(0)
        for k in range(200 if each < 40.0 else 0):
            total += term
            term *= -x / (k + 3)
        exact.append(float(total) if each < 40.0 else (each - 1.0) / each**2)
    torch.testing.assert_close(second_mean(z), numbers(*exact), rtol=4e-15, atol=0.0)
