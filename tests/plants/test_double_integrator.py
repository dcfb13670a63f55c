"""Masses under forces: closed forms."""

from __future__ import annotations

import numpy as np
import torch

from mann_torch.plants import DoubleIntegrator
from tests.plants.motion import energy_drift, moved


def test_motion_is_a_parabola_a_coordinate() -> None:
    plant = DoubleIntegrator(2)
    parameters = plant.parameters_of(masses=[2.0, 0.5])
    times = np.linspace(0.0, 3.0, 7)
    found = moved(plant, parameters, [1.0, -1.0, 0.5, 0.2], times, lambda t: [4.0, -1.0])
    t = torch.from_numpy(times).unsqueeze(-1)
    pull = torch.tensor([2.0, -2.0], dtype=torch.float64)
    start = torch.tensor([[1.0, -1.0], [0.5, 0.2]], dtype=torch.float64)
    torch.testing.assert_close(found.q, start[0] + start[1] * t + 0.5 * pull * t * t)
    torch.testing.assert_close(found.qd, start[1] + pull * t)


def test_energy_is_the_work_of_the_force() -> None:
    plant = DoubleIntegrator()
    parameters = plant.parameters_of(masses=[2.0])
    found = moved(plant, parameters, [0.0, 0.0], [0.0, 1.0, 3.0], lambda t: [4.0])
    energy = plant.energy(found, parameters)
    torch.testing.assert_close(energy, 4.0 * found.q[:, 0], rtol=1e-12, atol=1e-12)
    assert energy_drift(plant, [0.0, 1.5], 5.0) <= 1e-14
