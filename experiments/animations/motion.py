"""What a film shows: one draw of a run, with the plant that it moved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from mann_torch.plants import MechanicalPlant
from mann_torch.simulation import Scenario

from ..runs.figures import Arrays


@dataclass(frozen=True)
class Motion:
    """One draw of a run of a mechanical plant, K samples of it."""

    plant: MechanicalPlant
    parameters: dict[str, np.ndarray]  # (K, d) by name
    moved: tuple[str, ...]  # names of parameters that a schedule moves
    arrays: Arrays  # `signal_arrays` of the draw

    @property
    def t(self) -> np.ndarray:
        """(K,) [s]."""
        return self.arrays["t"]

    @property
    def q(self) -> np.ndarray:
        """Coordinates (K, n)."""
        return self.arrays[self.arrays["states"][0]]

    @property
    def applied(self) -> np.ndarray:
        """Inputs (K, m): what the plant got."""
        return self.arrays.get("applied", self.arrays["input"])

    def points(self, q: np.ndarray) -> np.ndarray:
        """The plant's points (K, k, 2) [m] at coordinates (K, n)."""
        rows = {name: torch.from_numpy(row) for name, row in self.parameters.items()}
        found = self.plant.points(torch.from_numpy(q), self.plant.Parameters(**rows))
        return found.numpy()

    def references(self) -> dict[str, np.ndarray]:
        """What was asked of each output (K,), by its name."""
        names = [channel.name for channel in self.plant.outputs]
        return dict(zip(names, self.arrays["reference"].T, strict=True))


def motion_of(plant: Any, scenario: Scenario, run: Arrays, member: int = 0) -> Motion:
    """Draw `member` of a scenario, of the draw's arrays, up to where it left the finite range."""
    parameters = {}
    for name, rows in zip(scenario.parameters._fields, scenario.parameters, strict=True):
        own = (rows if rows.dim() == 1 else rows[member]).numpy()
        parameters[name] = np.broadcast_to(own, (len(run["t"]), len(own)))
    called = run["parameters"][:, 0].tolist()
    parameters |= {name: run[kept] for name, kept in zip(scenario.schedule, called, strict=True)}
    whole = np.atleast_1d(np.isfinite(run[run["states"][0]]).all(-1))
    kept = len(whole) if whole.all() else max(1, int(np.argmin(whole)))
    shown = {n: a if a.dtype.kind == "U" else a[:kept] for n, a in run.items()}
    rows = {n: a[:kept].copy() for n, a in parameters.items()}
    return Motion(plant, rows, tuple(scenario.schedule), shown)
