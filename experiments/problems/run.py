"""A case's rollouts as its measures see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mann_torch import Trajectory

from ..building.build import Experiment
from ..runs.figures import Arrays


@dataclass(frozen=True)
class Run:
    """One rollout of one draw, and those beside it."""

    experiment: Experiment
    trajectory: Trajectory  # of batch (1,) or ()
    arrays: Arrays  # at samples, (K, .)
    others: tuple[Run, ...] = ()

    @property
    def t(self) -> np.ndarray:
        """All step times [s]."""
        return self.trajectory.t.numpy()

    def course(self, name: str) -> np.ndarray:
        """`output` or `error` at all steps, (T, p)."""
        rows: np.ndarray = getattr(self.trajectory, name).detach().numpy()
        return rows.reshape(len(rows), -1)

    def wanted(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The reference and its rate at times (T,) [s], (T, p) each."""
        seen = self.trajectory.signal(self.trajectory.t.new_tensor(t))
        value, rate = (part.numpy().reshape(len(t), -1) for part in (seen.value, seen.rate))
        return value, rate

    def at(self, name: str, time: float) -> np.ndarray:
        """A row of an array at a sample, flat."""
        place = int(np.argmin(np.abs(self.arrays["t"] - time)))
        row: np.ndarray = self.arrays[name][place]
        return row.reshape(-1)
