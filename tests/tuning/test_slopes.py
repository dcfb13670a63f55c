"""Slopes by differences, against objectives whose slopes are known."""

import math

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.tuning import Slope, differences, smoothed
from tests.conftest import generator, randn

B, P = 6, 3
SLOPES = torch.tensor([1.5, -0.7, 0.0], dtype=torch.float64)
ZERO = torch.zeros(P, dtype=torch.float64)


def linear(z: Tensor) -> Tensor:
    """A level a member, one slope for all."""
    return z @ SLOPES + torch.arange(B, dtype=torch.float64)


def test_differences_are_exact_for_a_quadratic() -> None:
    at = torch.tensor([0.3, -0.2, 0.5], dtype=torch.float64)
    slope = differences(lambda z: (z.square() @ SLOPES).expand(len(z), B), at, B, 0.4)
    assert torch.allclose(slope.mean, 2 * at * SLOPES, atol=1e-14)
    assert torch.allclose(slope.half, ZERO, atol=1e-14)


@pytest.mark.parametrize("design", ["each", "joint"])
@pytest.mark.parametrize("random", [True, False])
def test_smoothing_a_straight_line_changes_nothing(design: str, random: bool) -> None:
    chosen = generator(1) if random or design == "joint" else None
    slope = smoothed(linear, ZERO, B, pairs=2, design=design, generator=chosen)
    assert torch.allclose(slope.mean, SLOPES, atol=1e-12)
    assert slope.silent.tolist() == [False, False, True]


def test_smoothing_a_step_gives_the_slope_of_the_smoothed_step() -> None:
    """Fitted to a unit step at 0 over +- s, a line has the slope 3 / (4 s)."""

    def step(z: Tensor) -> Tensor:
        return (z[..., 0] > 0).to(torch.float64)

    spread = 0.2
    found = smoothed(step, ZERO[:1], 4000, spread=spread, pairs=3, generator=generator(2))
    assert float(found.mean) == pytest.approx(3 / (4 * spread), rel=0.01)
    by_quadrature = smoothed(step, ZERO[:1], 2, spread=spread, pairs=300)
    assert float(by_quadrature.mean) == pytest.approx(3 / (4 * spread), rel=1e-2)


def test_a_control_variate_takes_the_noise_of_others_away_and_no_slope() -> None:
    """Members differ in a slope that is known: only it makes the others noisy."""
    known = SLOPES + torch.stack([3.0 * randn(B, seed=3), torch.zeros(B), torch.zeros(B)], dim=-1)

    def values(z: Tensor) -> Tensor:
        return torch.einsum("cbp,bp->cb", z, known)

    plain = smoothed(values, ZERO, B, pairs=3, design="joint", generator=generator(4))
    control = torch.where(torch.tensor([True, False, False]), known, torch.nan)
    helped = smoothed(
        values, ZERO, B, pairs=3, design="joint", generator=generator(4), control=control
    )
    assert torch.allclose(helped.mean, known.mean(dim=0), atol=1e-12)
    assert helped.half[1] < 1e-9 < plain.half[1]
    assert helped.half[0] > 0.1  # members do differ in it


def test_intervals_contain_the_truth_about_as_often_as_they_say() -> None:
    inside = 0
    for seed in range(200):
        noise = generator(seed)

        def values(z: Tensor, noise: torch.Generator = noise) -> Tensor:
            return linear(z) + 0.1 * torch.randn(z.shape[:-1], generator=noise, dtype=torch.float64)

        slope = smoothed(values, ZERO, B, pairs=2, design="joint", generator=generator(1000 + seed))
        inside += int((slope.mean[0] - SLOPES[0]).abs() <= slope.half[0])
    assert 180 <= inside <= 199


def test_a_zero_or_an_interval_around_zero_is_silent() -> None:
    rows = torch.tensor([[0.0, 1.0, 1.0], [0.0, -1.0, 1.1]], dtype=torch.float64)
    assert Slope.of_members(rows, 0.0).silent.tolist() == [True, True, False]
    assert math.isnan(float(Slope.of_members(rows[:1], 0.0).half[0]))


@pytest.mark.parametrize(
    "settings",
    [
        {"spread": 0.0},
        {"spread": 3.0},
        {"pairs": 0},
        {"design": "all"},
        {"design": "joint"},  # no generator
        {"design": "joint", "generator": generator(), "pairs": 1, "members": 3},
    ],
)
def test_settings_that_cannot_work_are_named_errors(settings: dict[str, object]) -> None:
    members = settings.pop("members", B)
    with pytest.raises(mt.ConfigError):
        smoothed(linear, ZERO, members, **settings)  # type: ignore[arg-type]
