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

    def at(self, name: str, time: float) -> np.ndarray:
        """A row of an array at a sample, flat."""
        place = int(np.argmin(np.abs(self.arrays["t"] - time)))
        row: np.ndarray = self.arrays[name][place]
        return row.reshape(-1)
