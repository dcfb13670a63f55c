"""Scorecard N3: both engines against SciPy's Radau on equations written out in `by_hand`.

One case far from rest, with every term of the equations; the paper's scenarios lie in
test_papers_scenarios_against_radau.
"""

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.trees import map_tensors
from tests.simulation.by_hand import equations_of, radau
from tests.simulation.loops import case


def error(name: str, engine: str, dt: float, horizon: float) -> float:
    """The largest error of any state at the end."""
    made = case(name, horizon, batch=1)
    with torch.no_grad():
        run = made.run(solver=mt.Implicit(dt), engine=engine, sample_dt=horizon)
    states, memory = map_tensors(lambda x: x[:, 0], run.states), made.loop.controller.memory
    used = None if memory is None else memory.initial_active
    equations, (start, *_, end) = equations_of(made.loop, made.scenario, states, used)
    masses = made.scenario.schedule["masses"]
    found = radau(equations, masses, start, [0.0, horizon], rtol=1e-9, atol=1e-11)
    return float(np.abs(found[-1] - end).max())


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("soft", "soft_state_keys")]


@pytest.mark.parametrize("name", ["nn", *SLOW])
def test_the_compiled_engine_falls_to_radau_with_order_two(name: str) -> None:
    coarse, fine = (error(name, "compiled", dt, 0.1) for dt in (4e-5, 2e-5))
    assert fine <= 1e-6
    assert 3.6 <= coarse / fine <= 4.4, (coarse, fine)


@pytest.mark.slow
def test_the_torch_engine_meets_radau() -> None:
    assert error("nn", "torch", 5e-5, 0.1) <= 1e-6
