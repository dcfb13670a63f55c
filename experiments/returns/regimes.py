"""Scenarios in which regimes of a plant take turns and come back."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from mann_torch import MeasurementNoise, PiecewiseConstant, Scenario, Sinusoid
from mann_torch.plants import Plant

from ..settings.returning_config import ReturningConfig

#: Of the reference: amplitude and its spread [rad], periods a visit.
AMPLITUDE, AMPLITUDE_SPREAD, PERIODS = 1.0, 0.3, 2.0
#: Samples of noise a second, and its standard deviation where an accelerometer shows the moment.
NOISE_RATE, OF_MOMENT = 100.0, 0.05


def regimes(cfg: ReturningConfig, plant: Plant, count: int, first: int) -> Scenario:
    """`count` draws from number `first` on: weights of each regime, amplitude and noise.

    A draw is what a generator of its own number gives: the same whatever is drawn beside it.
    """
    base = plant.parameters_of().weights
    rows = [_draw(cfg, base, cfg.seed, first + k) for k in range(count)]
    weights, amplitude = (torch.stack(parts) for parts in zip(*rows, strict=True))
    visits = cfg.n_regimes * cfg.visits
    turns = torch.arange(visits) % cfg.n_regimes
    changes = cfg.visit_length * torch.arange(1, visits, dtype=torch.float64)
    schedule = PiecewiseConstant(changes.expand(count, -1), weights[:, turns])
    frequency = torch.full_like(amplitude, 2.0 * math.pi * PERIODS / cfg.visit_length)
    noise = None
    if any(cfg.noise):
        std = torch.tensor([*cfg.noise, OF_MOMENT], dtype=torch.float64)
        numbers = torch.arange(first, first + count) + (cfg.seed << 32)
        noise = MeasurementNoise(std.expand(count, -1), numbers, NOISE_RATE)
    return Scenario(
        Sinusoid(amplitude, frequency),
        plant.parameters_of(),
        visits * cfg.visit_length,
        schedule={"weights": schedule},
        noise=noise,
    )


def _draw(cfg: ReturningConfig, base: Tensor, seed: int, number: int) -> tuple[Tensor, Tensor]:
    """Weights (R, 6) and amplitude (1,)."""
    generator = torch.Generator().manual_seed(seed * 1_000_003 + number)
    spread = torch.tensor(cfg.spread, dtype=torch.float64)
    unit = 2.0 * torch.rand(cfg.n_regimes + 1, len(base), generator=generator).double() - 1.0
    return base + spread * unit[1:], AMPLITUDE + AMPLITUDE_SPREAD * unit[0, :1]
