"""From a checked configuration to the library's objects. Nothing is computed here."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from mann_torch import ClosedLoop, Implicit, MannController, Odeint, Scenario, Sinusoid, Solver
from mann_torch.errors import ConfigError
from mann_torch.memory import (
    ATTENTIONS,
    KEY_RULES,
    Attention,
    KeyRule,
    ReallocatingAttention,
    StateKeys,
    WorkingMemory,
)
from mann_torch.plants import PLANTS, TwoLinkArm, arm_parameters
from mann_torch.signals import PiecewiseConstant
from mann_torch.simulation import ADAPTIVE, FIXED, METHODS, check_engine
from mann_torch.types import PlantState

from ..settings.checks import check_horizon, holds_truth
from ..settings.config import SimulateConfig, SolverConfig
from .masses import mass_schedule
from .sizes import check_rollouts, check_steps, hidden_neurons
from .weights import check_draws, initial_weights


@dataclass(frozen=True)
class Experiment:
    """Everything a rollout needs, for a batch of draws."""

    loop: ClosedLoop
    scenario: Scenario
    solver: Solver
    weights: Any  # initial adaptive weights, (draws, *event)


def build(cfg: SimulateConfig, draws: Sequence[int] | None = None) -> Experiment:
    """Build and check a whole experiment: draws `initial.draw` on, or those that are named.

    Raises `ConfigError` (or a subclass) in one line, before anything large is allocated.
    """
    draws = range(cfg.draws) if draws is None else draws
    check_draws(cfg, draws)
    check_rollouts(f"draws = {len(draws)}", cfg, len(draws))
    scenario = build_scenario(cfg)
    controller = build_controller(cfg)
    _check_unused(cfg)
    loop = ClosedLoop(TwoLinkArm(cfg.plant.gravity), controller)
    solver = build_solver(cfg.solver)
    check_steps(scenario.end, solver.dt)
    check_engine(loop, scenario, solver, cfg.solver.engine, cfg.solver.device)
    return Experiment(loop, scenario, solver, initial_weights(cfg, controller, draws))


def _check_unused(cfg: SimulateConfig) -> None:
    """Check the settings that the chosen controller and keys do not use, too."""
    everything = dataclasses.replace(
        cfg,
        controller=dataclasses.replace(cfg.controller, attention="reallocating"),
        keys=dataclasses.replace(cfg.keys, name="state"),
    )
    build_controller(everything)
    _key_rule(cfg)
    matched = dataclasses.replace(cfg.controller, n_hidden=None)
    check_rollouts("controller.matched_hidden", dataclasses.replace(cfg, controller=matched), 1)


def build_scenario(cfg: SimulateConfig) -> Scenario:
    """The scenario, unbatched."""
    if cfg.plant.name not in PLANTS:
        raise ConfigError(f"unknown plant '{cfg.plant.name}'; choose from {', '.join(PLANTS)}")
    plant = cfg.plant
    lists = {
        "plant.masses": plant.masses,
        "plant.lengths": plant.lengths,
        "plant.viscous": plant.viscous,
        "plant.coulomb": plant.coulomb,
        "scenario.amplitude": cfg.scenario.amplitude,
        "scenario.frequency": cfg.scenario.frequency,
        "scenario.offset": cfg.scenario.offset,
        "scenario.q": cfg.scenario.q,
        "scenario.qd": cfg.scenario.qd,
    }
    for name, values in lists.items():
        if len(values) != 2:
            raise ConfigError(f"{name} = {list(values)}: give one number a joint (2)")
        if not all(math.isfinite(value) for value in values):
            raise ConfigError(f"{name} = {list(values)}: must be finite")
    parameters = arm_parameters(plant.masses, plant.lengths, plant.viscous, plant.coulomb)
    horizon = cfg.scenario.horizon if cfg.horizon is None else cfg.horizon
    check_horizon(horizon)
    times, masses = mass_schedule(cfg.scenario, plant.masses, horizon)
    return Scenario(
        reference=Sinusoid(cfg.scenario.amplitude, cfg.scenario.frequency, cfg.scenario.offset),
        parameters=parameters,
        horizon=horizon,
        schedule={"masses": PiecewiseConstant(times, masses)},
        start=PlantState(_column(cfg.scenario.q), _column(cfg.scenario.qd)),
        name=cfg.scenario.name,
    )


def _column(values: list[float]) -> torch.Tensor:
    return torch.tensor(list(values), dtype=torch.float64)


def build_controller(cfg: SimulateConfig) -> MannController:
    """The controller of the configuration, with its memory if it has one."""
    constants = cfg.constants
    n = TwoLinkArm.n_joints
    n_hidden = hidden_neurons(cfg)
    memory = None
    if cfg.controller.attention is not None:
        memory = WorkingMemory(
            cfg.memory.n_slots,
            n_hidden,
            _attention(cfg),
            _key_rule(cfg),
            context_width=n,
            write_gain=constants.write_gain,
            reset=cfg.memory.reset,
        )
    return MannController(
        n,
        n_hidden,
        memory,
        error_gain=_matrix(constants.error_gain),
        base_gain=constants.base_gain,
        robust_gain=constants.robust_gain,
        weight_bound=constants.weight_bound,
        rate_W=constants.rate_W,
        rate_V=constants.rate_V,
        e_modification=constants.e_modification,
        initial_std=cfg.initial.std,
    )


def _matrix(value: Any) -> torch.Tensor:
    wrong = ConfigError(
        f"constants.error_gain = {value}: a number, 2 diagonal entries or 2 rows of 2"
    )
    if holds_truth(value):
        raise wrong
    try:
        plain = [list(r) if hasattr(r, "__len__") else r for r in value]
    except TypeError:
        plain = value
    try:
        return torch.tensor(plain, dtype=torch.float64)
    except (TypeError, ValueError):
        raise wrong from None


def _attention(cfg: SimulateConfig) -> Attention:
    name = str(cfg.controller.attention)
    if name not in ATTENTIONS:
        raise ConfigError(f"unknown attention '{name}'; choose from {', '.join(ATTENTIONS)}")
    kind = ATTENTIONS[name]
    if kind is ReallocatingAttention:
        return ReallocatingAttention(cfg.controller.phase, cfg.constants.shift_threshold)
    return kind()


def _key_rule(cfg: SimulateConfig) -> KeyRule:
    if cfg.keys.name not in KEY_RULES:
        raise ConfigError(f"unknown keys '{cfg.keys.name}'; choose from {', '.join(KEY_RULES)}")
    kind = KEY_RULES[cfg.keys.name]
    return StateKeys(cfg.constants.key_rate) if kind is StateKeys else kind()


#: Settings that only some solvers take.
_SOLVER_SETTINGS = {
    "rtol": (*ADAPTIVE, "scipy_solver"),
    "atol": (*ADAPTIVE, "scipy_solver"),
    "max_step": FIXED,
    "follow_reference": ("implicit",),
}


def build_solver(cfg: SolverConfig) -> Solver:
    """The solver of that name. Raises `ConfigError`, for a setting that it would ignore too."""
    if cfg.name not in ("implicit", *METHODS):
        raise ConfigError(
            f"unknown solver '{cfg.name}'; choose from implicit, {', '.join(METHODS)}"
        )
    for name, takers in _SOLVER_SETTINGS.items():
        value = getattr(cfg, name)
        if cfg.name not in takers and value != getattr(SolverConfig, name):
            raise ConfigError(
                f"solver.{name} = {value}: {cfg.name} takes none; {', '.join(takers)} would"
            )
    if cfg.name == "implicit":
        return Implicit(cfg.dt, cfg.compile, cfg.follow_reference)
    inner = None if cfg.max_step is None else min(cfg.max_step, cfg.dt)
    return Odeint(cfg.name, cfg.dt, cfg.rtol, cfg.atol, inner, compile=cfg.compile)
