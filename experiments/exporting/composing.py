"""The controller of a configuration as a step, and what it has learned."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control import AdaptiveNetwork, Controller
from mann_torch.deployment import Stepper
from mann_torch.errors import MannError
from mann_torch.trees import map_tensors

from ..building.build import Experiment, build
from ..settings.config import ScenarioLoopConfig, SimulateConfig
from ..settings.export_config import ExportConfig
from ..tuning.held_out import constants_in

#: How often a step is taken where neither export nor clock say so [s].
USUAL_PERIOD = 1e-3


def experiment_of(cfg: ExportConfig) -> Experiment:
    """The loop with its constants, one draw of it, and what it starts from. Raises `ConfigError`.

    Tuned constants come before those of the configuration.
    """
    names = [field.name for field in dataclasses.fields(ScenarioLoopConfig)]
    plain = SimulateConfig(**{name: getattr(cfg, name) for name in names})
    if cfg.export.tuned is not None:
        tuned = constants_in("export.tuned", cfg.export.tuned)
        plain.constants = {**plain.constants, **{n: v.tolist() for n, v in tuned.items()}}
    made = build(plain)
    _keep_weights(made.loop.controller, map_tensors(lambda rows: rows[0], made.weights))
    return made


def stepper_of(cfg: ExportConfig, made: Experiment, engine: str = "compiled") -> Stepper:
    """The loop's controller as a step. Raises `ConfigError`, `ShapeError`."""
    period, clock = cfg.export.period, made.loop.clock
    if period is None and clock is None:
        period = USUAL_PERIOD
    return mt.deploy(made.loop, period, dtype=getattr(torch, cfg.export.dtype), engine=engine)


def _keep_weights(controller: Controller, weights: Any) -> None:
    """Make a draw of the initial weights what the controller itself starts from."""
    network = getattr(controller, "network", None)
    if isinstance(network, AdaptiveNetwork):
        with torch.no_grad():
            network.initial_V.copy_(weights.V)
            network.initial_b_v.copy_(weights.b_v)


def learned_state(cfg: ExportConfig, made: Experiment, stepper: Stepper) -> Tensor:
    """The state (size,) of a controller that has gone through the scenario in the simulator.

    What it then is, before a first step. Raises `MannError` where the loop is lost on the way.
    """
    with torch.inference_mode():
        run = mt.rollout(
            made.loop,
            made.scenario,
            made.solver,
            weights=made.weights,
            sample_dt=made.scenario.end,
            engine=cfg.solver.engine,
            device=cfg.solver.device,
        )
        (said,) = run.describe_status()
        if said != "ok":
            raise MannError(f"export.learned: the loop {said}")
        like = stepper.unpacked(first_state(cfg, made, stepper))
        states, modes = (
            map_tensors(lambda rows: rows[-1, 0], tree) for tree in (run.states, run.modes)
        )
        kept = like._replace(controller=states.controller, mode=modes)
        if like.model is not None:
            kept = kept._replace(model=states.model)
        return stepper.packed(kept)


def first_state(cfg: ExportConfig, made: Experiment, stepper: Stepper) -> Tensor:
    """The state (size,) of a controller that has seen nothing yet."""
    ports, scenario = stepper.ports, made.alone or made.scenario
    zero = torch.zeros((), dtype=torch.float64)
    sample = scenario.reference(zero)
    coefficients = made.loop.plant.coefficients(scenario.parameters)
    start = made.loop.plant.rest() if scenario.start is None else scenario.start
    seen = made.loop.plant.measure(start, coefficients)
    reference, measurement = (
        torch.cat(list(row)).to(stepper.dtype) for row in (sample.upto(ports.order), seen)
    )
    return stepper.initial_state(reference, measurement)
