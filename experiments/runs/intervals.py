"""A mean over draws with its 95 % interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from mann_torch.statistics import mean_and_half


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
