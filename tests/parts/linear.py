"""A small loop whose every number is known: a double integrator under linear feedback."""

from __future__ import annotations

from typing import Any

import mann_torch as mt
from mann_torch.control import LinearFeedback
from mann_torch.plants import LinearPlant
from mann_torch.signals import Sinusoid

PLANT = LinearPlant([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], "state")


def loop(feedback: tuple[float, float] = (4.0, 3.0), **parts: Any) -> mt.ClosedLoop:
    """x'' = u, u = 4 r - 4 x - 3 x'."""
    return mt.ClosedLoop(PLANT, LinearFeedback([list(feedback)], [[feedback[0]]]), **parts)


def scenario(horizon: float = 0.5, **other: Any) -> mt.Scenario:
    other = {"reference": Sinusoid([1.0], 2.0), "start": PLANT.rest(), **other}
    return mt.Scenario(parameters=PLANT.parameters_of(), horizon=horizon, **other)
