"""Motion of a plant by an integrator of another house, and its facts in numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from scipy.integrate import solve_ivp
from torch import Tensor

from mann_torch.plants import Plant
from mann_torch.trees import Packer


def rate_of(
    plant: Plant, parameters: Any, u: Callable[[float], list[float]]
) -> tuple[Packer, Callable]:
    """The state's packer, and d/dt of a flat state as SciPy wants it, under the input u(t)."""
    packer, c = Packer(plant.rest(), 0), plant.coefficients(parameters)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        input = plant.grouped(torch.tensor(u(t), dtype=torch.float64))
        time = torch.tensor(t, dtype=torch.float64)
        with torch.no_grad():
            state = packer.unpack(torch.from_numpy(np.ascontiguousarray(y)))
            return packer.pack(plant.derivative(time, state, input, None, c)).numpy()

    return packer, rate


def moved(
    plant: Plant,
    parameters: Any,
    start: list[float],
    times: list[float] | np.ndarray,
    u: Callable[[float], list[float]] | None = None,
    **settings: Any,
) -> Any:
    """States (T, d) at times from 0 on, to 11 digits."""
    none = [0.0] * len(plant.inputs)
    packer, rate = rate_of(plant, parameters, u or (lambda t: none))
    settings = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12, **settings}
    solved = solve_ivp(rate, (0.0, times[-1]), start, t_eval=times, **settings)
    assert solved.success
    return packer.unpack(torch.from_numpy(solved.y.T.copy()))


def energy_drift(plant: Any, start: list[float], horizon: float, **values: Any) -> float:
    """Largest change of the energy of a free plant, of the largest energy."""
    parameters = plant.parameters_of(**values)
    states = moved(plant, parameters, start, np.linspace(0.0, horizon, 41), rtol=1e-12, atol=1e-13)
    energy: Tensor = plant.energy(states, plant.coefficients(parameters))
    return float((energy - energy[0]).abs().max() / energy.abs().max())
