"""The same stretch of scenario 1 by the W-method and by torchdiffeq."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from omegaconf import OmegaConf

import mann_torch as mt
from experiments.building.build import build
from experiments.command.cli import compose_job
from experiments.settings.config import SimulateConfig


def final_angles(controller: str, horizon: float, solver: mt.Solver) -> torch.Tensor:
    """Joint angles every 0.1 s, (K, 2)."""
    cfg = OmegaConf.to_object(compose_job("simulate", [f"controller={controller}"]))
    assert isinstance(cfg, SimulateConfig)
    cfg = dataclasses.replace(cfg, horizon=horizon)
    parts = build(cfg)
    with torch.inference_mode():
        run = mt.rollout(parts.loop, parts.scenario, solver, weights=parts.weights, sample_dt=0.1)
    assert run.status.tolist() == [0]
    return run.states.plant.q[:, 0]


def compare(controller: str, horizon: float) -> None:
    angles = {
        "implicit": final_angles(controller, horizon, mt.Implicit(dt=1e-3)),
        "following": final_angles(controller, horizon, mt.Implicit(5e-3, follow_reference=True)),
        "dopri5": final_angles(controller, horizon, mt.Odeint("dopri5", dt=5e-3)),
        "rk4": final_angles(controller, horizon, mt.Odeint("rk4", dt=5e-3, max_step=2e-4)),
    }
    for name in ("implicit", "following", "dopri5"):
        gap = float((angles[name] - angles["rk4"]).abs().max())
        print(f"{controller}, {horizon} s, {name} - rk4: {gap:.2e} rad")
        assert gap <= 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["nn", "soft"])
def test_the_first_half_second_of_scenario_1(controller: str) -> None:
    compare(controller, 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["nn", "soft"])
def test_twenty_seconds_of_scenario_1(controller: str) -> None:
    compare(controller, 20.0)
