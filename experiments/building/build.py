"""From a checked configuration to the library's objects. Nothing is computed here."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import torch

from mann_torch import ClosedLoop, Implicit, MannController, Odeint, Scenario, Sinusoid, Solver
from mann_torch.control import equal_parameter_hidden
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
from mann_torch.simulation import METHODS, check_engine
from mann_torch.types import NetworkState, PlantState

from ..settings.config import SimulateConfig, SolverConfig
from .masses import mass_schedule
from .weights import initial_network

#: A run of more steps, or with more samples, is a slip of the pen.
MAX_STEPS = 1e8


@dataclass(frozen=True)
class Experiment:
    """Everything a rollout needs, for a batch of draws."""

    loop: ClosedLoop
    scenario: Scenario
    solver: Solver
    network: NetworkState  # (draws, *event)


def build(cfg: SimulateConfig) -> Experiment:
    """Build and check a whole experiment. Raises `ConfigError` (or a subclass) in one line."""
    if cfg.draws < 1:
        raise ConfigError(f"draws = {cfg.draws}: at least 1")
    if not 0 <= cfg.output.member < cfg.draws:
        raise ConfigError(
            f"output.member = {cfg.output.member}: there are {cfg.draws} draws, from 0"
        )
    if not (math.isfinite(cfg.output.sample_dt) and cfg.output.sample_dt > 0):
        raise ConfigError(f"output.sample_dt = {cfg.output.sample_dt}: must be finite and > 0")
    scenario = build_scenario(cfg)
    controller = build_controller(cfg)
    _check_unused(cfg)
    loop = ClosedLoop(TwoLinkArm(cfg.plant.gravity), controller)
    solver = build_solver(cfg.solver)
    if scenario.end / solver.dt > MAX_STEPS or scenario.end / cfg.output.sample_dt > MAX_STEPS:
        raise ConfigError(
            f"horizon = {scenario.end:g} s in steps of {solver.dt:g} s, sampled every "
            f"{cfg.output.sample_dt:g} s: more than {MAX_STEPS:.0e} steps or samples"
        )
    check_engine(loop, scenario, solver, cfg.solver.engine, cfg.solver.device)
    return Experiment(loop, scenario, solver, initial_network(cfg, controller))


def _check_unused(cfg: SimulateConfig) -> None:
    """Check the settings that the chosen controller, keys and solver do not use, too."""
    everything = dataclasses.replace(
        cfg,
        controller=dataclasses.replace(cfg.controller, attention="reallocating"),
        keys=dataclasses.replace(cfg.keys, name="state"),
    )
    build_controller(everything)
    _key_rule(cfg)
    build_solver(dataclasses.replace(cfg.solver, name="dopri5"))


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
    if not (math.isfinite(horizon) and horizon > 0):
        raise ConfigError(f"horizon = {horizon}: must be finite and > 0")
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
    n_hidden = cfg.controller.n_hidden
    if n_hidden is None:
        slots, hidden = cfg.memory.n_slots, cfg.controller.matched_hidden
        n_hidden = equal_parameter_hidden(5 * n, n, hidden, slots)
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
    try:
        plain = [list(r) if hasattr(r, "__len__") else r for r in value]
    except TypeError:
        plain = value
    try:
        return torch.tensor(plain, dtype=torch.float64)
    except (TypeError, ValueError):
        raise ConfigError(
            f"constants.error_gain = {value}: a number, 2 diagonal entries or 2 rows of 2"
        ) from None


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


def build_solver(cfg: SolverConfig) -> Solver:
    """The solver of that name."""
    if cfg.name == "implicit":
        return Implicit(cfg.dt, cfg.compile, cfg.follow_reference)
    if cfg.name not in METHODS:
        raise ConfigError(
            f"unknown solver '{cfg.name}'; choose from implicit, {', '.join(METHODS)}"
        )
    inner = None if cfg.max_step is None else min(cfg.max_step, cfg.dt)
    return Odeint(cfg.name, cfg.dt, cfg.rtol, cfg.atol, inner, compile=cfg.compile)
