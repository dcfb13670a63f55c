"""From a checked configuration to the library's objects. Nothing is computed here."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from mann_torch import ClosedLoop, Scenario, Solver
from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError
from mann_torch.functional import as_float64
from mann_torch.plants import Plant
from mann_torch.simulation import check_engine
from mann_torch.simulation.starting import start_of
from mann_torch.trees import map_tensors

from ..settings.checks import check_horizon
from ..settings.config import LoopConfig, SimulateConfig
from .controller_kinds import is_mann, mann_settings
from .controllers import build_controller, constant, paper_constants
from .made import named, unknown
from .parts import build_noise, build_parts
from .plants import build_plant, build_start
from .schedules import schedules
from .signals import build_disturbance, build_reference
from .sizes import check_noise, check_rollouts, check_states, check_steps
from .solvers import build_solver
from .weights import check_draws, initial_weights


@dataclass(frozen=True)
class Experiment:
    """Everything a rollout needs, for a batch of draws."""

    loop: ClosedLoop
    scenario: Scenario  # of batch shape (draws,) where draws differ in it or in nothing else
    solver: Solver
    weights: Any  # initial adaptive weights, (draws, *event); None where there are none
    alone: Scenario | None = None  # unbatched, without noise


def build(cfg: SimulateConfig, draws: Sequence[int] | None = None) -> Experiment:
    """Build and check a whole experiment: draws `initial.draw` on, or those that are named.

    Raises `ConfigError` (or a subclass) in one line, before anything large is allocated.
    """
    draws = range(cfg.draws) if draws is None else draws
    check_draws(cfg, draws)
    number("problem.effort_after", cfg.problem.effort_after, NONNEGATIVE)
    plant, parameters = build_plant(cfg.plant)
    check_rollouts(f"draws = {len(draws)}", cfg, plant, len(draws))
    alone = build_scenario(cfg, plant, parameters)
    loop = build_loop(cfg, plant)
    if alone.batch_shape != () or loop.batch_shape() != ():
        raise ConfigError("rows of rows where one row is asked for: a configuration is one task")
    if is_mann(cfg):
        _check_unused(cfg, plant)
    solver = build_solver(cfg.solver)
    check_steps(alone.end, solver.dt)
    check_engine(loop, alone, solver, cfg.solver.engine, cfg.solver.device)
    weights = initial_weights(cfg, loop.controller, draws)
    check_states(f"draws = {len(draws)}", _start(cfg, loop, alone, weights), len(draws))
    scenario = _of_draws(cfg, loop, alone, draws, weights, solver.dt)
    return Experiment(loop, scenario, solver, weights, alone)


def build_loop(cfg: LoopConfig, plant: Plant) -> ClosedLoop:
    """Plant, controller and parts with their constants. Raises `ConfigError`.

    A constant that only another controller of the paper's has is not used.
    """
    loop = ClosedLoop(plant, build_controller(cfg, plant), **build_parts(cfg, plant))
    there, values = loop.constants(), {}
    for name, given in cfg.constants.items():
        value = constant(f"constants.{name}", given)
        if name in there:
            event = there[name].shape
            values[name] = loop.domain(name).coerce(value, event)
            if values[name].shape != event:
                raise ConfigError(f"constants.{name} = {given}: must be of shape {tuple(event)}")
        elif name not in paper_constants():
            raise unknown("constants", name, f"controller '{cfg.controller.get('name')}'", there)
    named("constants", values, lambda: loop.initialize(**values))
    return loop


def _check_unused(cfg: SimulateConfig, plant: Plant) -> None:
    """Check the settings that the chosen controller and keys do not use, too."""
    settings = dataclasses.asdict(mann_settings(cfg))
    everything = dataclasses.replace(
        cfg,
        controller={**settings, "attention": "reallocating"},
        keys=dataclasses.replace(cfg.keys, name="state"),
        network=None,
        law=None,
    )
    build_loop(everything, plant)
    build_controller(dataclasses.replace(everything, keys=cfg.keys), plant)
    matched = dataclasses.replace(cfg, controller={**settings, "n_hidden": None})
    check_rollouts("controller.matched_hidden", matched, plant, 1)


def build_scenario(cfg: SimulateConfig, plant: Plant, parameters: Any) -> Scenario:
    """The scenario, unbatched and without noise. Raises `ConfigError`, for one of another plant."""
    horizon = cfg.scenario.horizon if cfg.horizon is None else cfg.horizon
    check_horizon(horizon)
    nodes = {"scenario.reference": cfg.scenario.reference, "reference": cfg.reference}
    given = {where: node for where, node in nodes.items() if node is not None}
    if not given:
        raise ConfigError(f"scenario '{cfg.scenario.name}' has no reference: choose reference=...")
    width = len(plant.outputs)
    every = {where: build_reference(where, node, width) for where, node in given.items()}
    where, reference = list(every.items())[-1]  # what is not used has been checked, too
    if reference.width != len(plant.outputs):
        names = ", ".join(channel.name for channel in plant.outputs)
        raise ConfigError(
            f"{where} gives {reference.width} numbers, {cfg.plant['name']} has "
            f"{len(plant.outputs)} outputs ({names}): give one an output, or choose "
            "scenario=plain or reference=..."
        )
    return Scenario(
        reference=reference,
        parameters=parameters,
        horizon=horizon,
        schedule=schedules(cfg.scenario, plant, parameters, horizon),
        start=build_start(plant, cfg.scenario.start),
        disturbance=build_disturbance(cfg.disturbance, plant, parameters),
        name=cfg.scenario.name,
    )


def _start(cfg: LoopConfig, loop: ClosedLoop, scenario: Scenario, weights: Any) -> Any:
    """State and mode that one draw starts from.

    Raises `ConfigError` where controller, plant and signals do not go together.
    """
    first = map_tensors(lambda leaf: leaf[0], weights)
    try:
        with torch.inference_mode():
            return start_of(loop, scenario, first)[:2]
    except (AttributeError, TypeError, IndexError) as error:
        raise ConfigError(
            f"controller '{cfg.controller.get('name')}' can't control plant "
            f"'{cfg.plant['name']}': {str(error).splitlines()[0]}"
        ) from None
    except RuntimeError as error:
        if isinstance(error, MemoryError):
            raise
        raise ConfigError(
            f"controller '{cfg.controller.get('name')}' and plant '{cfg.plant['name']}': "
            f"{str(error).splitlines()[0]}"
        ) from None


def _of_draws(
    cfg: LoopConfig,
    loop: ClosedLoop,
    alone: Scenario,
    draws: Sequence[int],
    weights: Any,
    dt: float,
) -> Scenario:
    """The scenario of all draws: with noise of their own, batched where weights do not do so."""
    numbers = [cfg.initial.draw + draw for draw in draws]
    noise = build_noise(cfg, numbers)
    if noise is not None:
        rest, c = loop.plant.rest(), loop.plant.coefficients(alone.parameters)
        widths = [part.shape[-1] for part in loop.plant.measure(rest, c)]
        check_noise(noise, widths, alone.end, dt)
        return dataclasses.replace(alone, noise=noise)
    if weights is None:
        return dataclasses.replace(alone, horizon=as_float64(alone.horizon).expand(len(draws)))
    return alone
