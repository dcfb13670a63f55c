"""Parts that public calls are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mann_torch as mt
from tests.conftest import generator, make_loop, make_scenario

Call = tuple[Callable[..., Any], dict[str, Any]]

LOOP, SCENARIO, SOLVER = (
    make_loop("reallocating_always"),
    make_scenario(0.02, (0.01,)),
    mt.Implicit(),
)
CONTROLLER = LOOP.controller
NETWORK = CONTROLLER.initial_weights((2,), generator())
NOISE = mt.MeasurementNoise([0.1, 0.1], [0, 1])
RUN = mt.rollout(LOOP, SCENARIO, weights=NETWORK, engine="torch", effort_after=0.0)
ROLLOUT = {"loop": LOOP, "scenario": SCENARIO, "solver": SOLVER, "weights": NETWORK}
BATCH = mt.Scenario.stack([SCENARIO, SCENARIO])
