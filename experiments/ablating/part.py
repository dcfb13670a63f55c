"""A row of a table, as it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Part:
    """What one variant came to."""

    measures: dict[str, np.ndarray]  # (seeds,) each
    told: dict[str, np.ndarray]  # numbers that it has beside its name
    curve: np.ndarray  # (K,) error over time, or accuracy over iterations, mean over seeds
    at: np.ndarray  # (K,) [s], or iterations
