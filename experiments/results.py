"""Results of all jobs, looked up by scenario and variant, and their statistics over draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mann_torch.statistics import mean_and_half

from .jobs import JobResult


@dataclass(frozen=True)
class Interval:
    """A mean with its 95 % interval over draws; half is NaN for a single draw."""

    mean: float
    half: float

    @property
    def excludes_zero(self) -> bool:
        """Whether the interval leaves 0 out; False where there is none."""
        return abs(self.mean) > self.half

    def __str__(self) -> str:
        spread = "" if math.isnan(self.half) else f" ± {self.half:.1f}"
        return f"{self.mean:+.1f}{spread} %"


def interval(values: np.ndarray) -> Interval:
    """Mean and Student-t 95 % half-width of independent values (draws,)."""
    mean, half = mean_and_half(torch.as_tensor(values))
    return Interval(float(mean), float(half))


class Results:
    """SRMSE x 10^3 and signals of every simulated (scenario, variant)."""

    def __init__(self, results: Sequence[JobResult]) -> None:
        self._by_variant = {result.job.variant: result for result in results}

    def job(self, variant: str) -> JobResult:
        """All results of one variant."""
        return self._by_variant[variant]

    def has(self, scenario: str, variant: str) -> bool:
        """Whether that pair was simulated."""
        found = self._by_variant.get(variant)
        return found is not None and scenario in found.job.scenarios

    def srmse(self, scenario: str, variant: str, metric: str = "srmse") -> np.ndarray:
        """SRMSE x 10^3 (draws, 2)."""
        result = self._by_variant[variant]
        table: np.ndarray = getattr(result, metric)
        return 1e3 * table[result.job.scenarios.index(scenario)]

    def signals(self, scenario: str, variant: str) -> dict[str, np.ndarray]:
        """Recorded signals, (K, draws, .)."""
        return self._by_variant[variant].signals[scenario]

    def change(
        self, scenario: str, of: str, against: str, joint: int, metric: str = "srmse"
    ) -> Interval:
        """Paired difference of `of` from `against` over draws, in % of `against`'s mean."""
        base = self.srmse(scenario, against, metric)[:, joint]
        difference = self.srmse(scenario, of, metric)[:, joint] - base
        return interval(100.0 * difference / base.mean())
