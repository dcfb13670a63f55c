"""A benchmark problem whose constants are tuned: members to learn from, members to be judged on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from mann_torch.tuning import Ensemble, Judged


@dataclass(frozen=True)
class Members:
    """An ensemble with its judges: RMS error and RMS input of each member."""

    ensemble: Ensemble
    error: Judged
    effort: Judged


#: Values of constants, by name.
Known = Mapping[str, float | list[float]]


@dataclass(frozen=True)
class Way:
    """Constants to be judged: some that are known, or what tuning makes of them."""

    note: str  # how a table calls them
    known: Known = field(default_factory=dict)  # 1. set,
    tuned: Sequence[str] = ()  # 2. tuned from there


@dataclass(frozen=True)
class TunedProblem:
    """What is tuned on what. The first way is what all others are compared with."""

    title: str
    unit: str  # of the error
    ways: Mapping[str, Way]
    train: Members
    held_out: Members


def uniform(count: int, low: float, high: float, generator: torch.Generator) -> Tensor:
    """`count` numbers between low and high."""
    return low + (high - low) * torch.rand(count, generator=generator, dtype=torch.float64)


def beside(samples: Tensor, like: Tensor) -> Tensor:
    """Samples (K, B, p) of all members, aligned with (K, ..., B, p)."""
    lead = like.dim() - samples.dim()
    return samples.reshape(samples.shape[0], *(1,) * lead, *samples.shape[1:])


def root_mean_square(rows: Tensor) -> Tensor:
    """Over samples, of their norms: (K, ..., p) -> (...)."""
    return rows.square().sum(dim=-1).mean(dim=0).sqrt()
