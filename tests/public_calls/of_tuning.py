"""Calls of tuning."""

from __future__ import annotations

import torch

import mann_torch as mt
from mann_torch import tuning
from tests.conftest import generator
from tests.public_calls.things import BATCH, CONTROLLER, LOOP, NETWORK, ROLLOUT, RUN, SOLVER, Call

ENSEMBLE = tuning.Ensemble(LOOP, BATCH, NETWORK, SOLVER, {}, 0.0, "torch")
COORDINATES = tuning.Coordinates(CONTROLLER, ["rate_W"])
Z = torch.zeros(1, dtype=torch.float64)
SETTINGS = tuning.GradientSettings("fd")
TUNER = tuning.Tuner(ENSEMBLE, COORDINATES, tuning.Objective(), SETTINGS, tuning.Schedule(1))


def judge(run: mt.Outcome) -> torch.Tensor:
    return mt.srmse(run).sum(-1)


def values(points: torch.Tensor) -> torch.Tensor:
    return points.square().sum(-1)


SMOOTHED = {"values": values, "z": Z, "members": 2}
SLOPE = {"ensemble": ENSEMBLE, "coordinates": COORDINATES, "z": Z, "judge": judge}

CALLS: dict[str, Call] = {
    "Coordinates": (
        tuning.Coordinates,
        {"module": CONTROLLER, "names": ["rate_W"], "matrix_form": "scalar"},
    ),
    "Coordinates.values": (COORDINATES.values, {"z": Z}),
    "Limit": (tuning.Limit, {"quantity": judge, "bound": 1.0, "relative": False}),
    "Criterion": (
        tuning.Criterion,
        {"value": judge, "limits": {}, "penalty": 20.0, "scale": 1.0},
    ),
    "Objective": (
        tuning.Objective,
        {
            "effort_weight": 0.0,
            "rate_limit": 1.0,
            "peak_limit": 1.0,
            "saturation": 1.0,
            "penalty": 20.0,
        },
    ),
    "Ensemble": (
        tuning.Ensemble,
        {
            **ROLLOUT,
            "scenario": BATCH,
            "own": {},
            "effort_after": 0.0,
            "engine": "torch",
            "device": "cpu",
        },
    ),
    "Ensemble.until": (ENSEMBLE.until, {"horizon": 1.0}),
    "Ensemble.select": (ENSEMBLE.select, {"members": [0]}),
    "Ensemble.scores": (ENSEMBLE.scores, {"values": {}, "progress": None}),
    "Ensemble.judged": (ENSEMBLE.judged, {"values": {}, "judge": judge, "progress": None}),
    "Ensemble.run": (
        ENSEMBLE.run,
        {
            "values": {},
            "gradient": "soft",
            "temperature": 0.1,
            "progress": None,
            "recording": tuning.TOTALS,
        },
    ),
    "constants_at": (
        lambda module, values: tuning.constants_at(module, values).__enter__(),
        {"module": CONTROLLER, "values": {}},
    ),
    "score": (tuning.score, {"trajectory": RUN}),
    "Judged": (tuning.Judged, {"judge": judge, "recording": tuning.MOTION}),
    "Recording": (
        tuning.Recording,
        {"motion_dt": 0.1, "sample_dt": 0.1, "sample_until": 1.0, "totals_only": False},
    ),
    "GradientSettings": (
        tuning.GradientSettings,
        {
            "mode": "fd",
            "spread": 0.1,
            "pairs": 2,
            "design": "each",
            "control": (),
            "step": 0.1,
            "temperature": 0.1,
            "final_temperature": 0.1,
        },
    ),
    "slope_of": (
        tuning.slope_of,
        {**SLOPE, "settings": SETTINGS, "generator": generator(), "progress": 0.0},
    ),
    "pathwise_slopes": (tuning.pathwise_slopes, {**SLOPE, "mode": "soft", "temperature": 0.1}),
    "control_of": (
        tuning.control_of,
        {"exact": torch.zeros(2, 1), "coordinates": COORDINATES, "names": ["rate_W"]},
    ),
    "differences": (tuning.differences, {**SMOOTHED, "step": 0.1}),
    "smoothed": (
        tuning.smoothed,
        {
            **SMOOTHED,
            "spread": 0.1,
            "pairs": 2,
            "design": "each",
            "generator": generator(),
            "control": torch.zeros(2, 1),
        },
    ),
    "Schedule": (
        tuning.Schedule,
        {
            "iterations": 2,
            "optimizer": "adam",
            "rate": 0.1,
            "minibatch": 2,
            "curriculum": [(0, 1.0)],
            "seed": 0,
        },
    ),
    "Tuner": (
        tuning.Tuner,
        {
            "ensemble": ENSEMBLE,
            "coordinates": COORDINATES,
            "objective": tuning.Objective(),
            "gradient": SETTINGS,
            "schedule": tuning.Schedule(1),
            "history": [],
            "begin": None,
        },
    ),
    "Tuner.load_state_dict": (TUNER.load_state_dict, {"state": TUNER.state_dict()}),
}
