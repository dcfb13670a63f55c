"""Results of all jobs, looked up by scenario and variant, and their statistics over draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..runs.intervals import Interval, interval
from .jobs import JobResult


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
