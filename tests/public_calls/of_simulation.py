"""Calls of simulation and metrics."""

from __future__ import annotations

import mann_torch as mt
from mann_torch import parts, signals, simulation
from tests.conftest import generator
from tests.public_calls.things import (
    BATCH,
    CONTROLLER,
    LOOP,
    NOISE,
    ROLLOUT,
    RUN,
    SCENARIO,
    SOLVER,
    Call,
)

LOOPS_OWN = {
    "actuator": parts.Actuator(2, limit=10.0),
    "sensor": parts.Sensor(quantum=0.01),
    "clock": parts.Clock(0.01),
    "model": parts.SecondOrderModel(2, 3.0),
}
TRACK = {"after": 0.01, "trajectory": RUN}

CALLS: dict[str, Call] = {
    "ClosedLoop": (mt.ClosedLoop, {"plant": LOOP.plant, "controller": CONTROLLER, **LOOPS_OWN}),
    "Scenario": (
        mt.Scenario,
        {
            "reference": SCENARIO.reference,
            "parameters": SCENARIO.parameters,
            "horizon": 0.02,
            "schedule": {},
            "start": mt.TwoLinkArm().rest(),
            "noise": NOISE,
            "disturbance": signals.Disturbance(input=SCENARIO.reference),
            "name": "mine",
        },
    ),
    "Scenario.stack": (mt.Scenario.stack, {"scenarios": [SCENARIO], "name": "mine"}),
    "Scenario.select": (BATCH.select, {"members": [0]}),
    "Implicit": (mt.Implicit, {"dt": 4e-3, "compile": False, "follow_reference": True}),
    "RungeKutta": (mt.RungeKutta, {"dt": 1e-3, "compile": False}),
    "Odeint": (
        mt.Odeint,
        {
            "method": "rk4",
            "dt": 4e-3,
            "rtol": 1e-5,
            "atol": 1e-8,
            "max_step": 1e-3,
            "max_evaluations": 100,
            "compile": False,
        },
    ),
    "rollout": (
        mt.rollout,
        {
            **ROLLOUT,
            "sample_dt": 0.01,
            "sample_until": 0.01,
            "motion_dt": 0.01,
            "effort_after": 0.0,
            "divergence_limit": 1e8,
            "engine": "torch",
            "device": "cpu",
            "tape_memory": 256e6,
            "gradient": "soft",
            "temperature": 0.1,
            "progress": lambda steps: None,
        },
    ),
    "rollout of a draw": (
        lambda batch_shape, generator=None: mt.rollout(
            LOOP, SCENARIO, generator=generator, batch_shape=batch_shape, engine="torch"
        ),
        {"generator": generator(), "batch_shape": (2,)},
    ),
    "rollout that goes on": (
        lambda begin=None: mt.rollout(LOOP, SCENARIO, begin=begin, engine="torch"),
        {"begin": RUN.end},
    ),
    "explain": (mt.explain, {**ROLLOUT, "gradient": "soft", "temperature": 0.1}),
    "observe": (mt.observe, {"loop": LOOP, "scenario": SCENARIO, "trajectory": RUN}),
    "attended_slot": (simulation.attended_slot, {"trajectory": RUN}),
    "check_engine": (
        simulation.check_engine,
        {
            "loop": LOOP,
            "scenario": SCENARIO,
            "solver": SOLVER,
            "engine": "torch",
            "device": "cpu",
        },
    ),
    "check_gradient": (
        simulation.check_gradient,
        {"gradient": "soft", "solver": SOLVER, "temperature": 0.1, "loop": LOOP},
    ),
    "srmse": (mt.srmse, TRACK),
    **{
        name: (getattr(mt, name), {"trajectory": RUN})
        for name in ("input_rate", "peak_input", "reallocations", "switches")
    },
}
