"""From a checked configuration to the library's objects. Nothing is computed here."""

from __future__ import annotations

import math
import re
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
from mann_torch.signals import PiecewiseConstant, growing_square, multiplied
from mann_torch.simulation import METHODS
from mann_torch.types import NetworkState, PlantState

from .config import ReproduceConfig, ScenarioConfig, SimulateConfig, SolverConfig
from .weights import inner_weights

_SQRT = re.compile(r"sqrt\(\s*([0-9.eE+-]+)\s*\)")


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
    if not (math.isfinite(cfg.output.sample_dt) and cfg.output.sample_dt > 0):
        raise ConfigError(f"output.sample_dt = {cfg.output.sample_dt}: must be finite and > 0")
    scenario = build_scenario(cfg)
    controller = build_controller(cfg)
    loop = ClosedLoop(TwoLinkArm(cfg.plant.gravity), controller)
    solver = build_solver(cfg.solver)
    return Experiment(loop, scenario, solver, initial_network(cfg, controller))


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


def mass_schedule(
    scenario: ScenarioConfig, masses: list[float], horizon: float
) -> tuple[list[float], list[list[float]]]:
    """Jump times [s] and mass rows [kg] of a scenario, up to its horizon."""
    if scenario.mass_growth is not None:
        if scenario.mass_jumps:
            raise ConfigError("scenario: give mass_jumps or mass_growth, not both")
        growth = scenario.mass_growth
        if not (growth.increment > 0 and growth.period > 0 and math.isfinite(growth.increment)):
            raise ConfigError("scenario.mass_growth: increment and period must be > 0")
        count = math.ceil(horizon / growth.period) - 1
        times = [growth.period * (n + 1) for n in range(count)]
        return times, growing_square(masses, growth.increment, count)
    times, factors = [], []
    for jump in scenario.mass_jumps:
        if (not isinstance(jump, list | tuple) and not hasattr(jump, "__len__")) or len(jump) != 2:
            raise ConfigError(f"scenario.mass_jumps: '{jump}' is not [time, factor]")
        times.append(_number(jump[0], "time"))
        factors.append(_number(jump[1], "factor"))
    if any(factor <= 0 for factor in factors):
        raise ConfigError(f"scenario.mass_jumps: factors {factors} must be > 0")
    return times, multiplied(masses, factors)


def _number(value: Any, what: str) -> float:
    match = _SQRT.fullmatch(value.strip()) if isinstance(value, str) else None
    try:
        number = math.sqrt(float(match.group(1))) if match else float(value)
    except (TypeError, ValueError):
        raise ConfigError(
            f"scenario.mass_jumps: {what} '{value}' is neither a number nor sqrt(number)"
        ) from None
    if not math.isfinite(number):
        raise ConfigError(f"scenario.mass_jumps: {what} {value} must be finite")
    return number


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
        return Implicit(cfg.dt, cfg.compile)
    if cfg.name not in METHODS:
        raise ConfigError(
            f"unknown solver '{cfg.name}'; choose from implicit, {', '.join(METHODS)}"
        )
    inner = None if cfg.max_step is None else min(cfg.max_step, cfg.dt)
    return Odeint(cfg.name, cfg.dt, cfg.rtol, cfg.atol, inner, compile=cfg.compile)


def initial_network(
    cfg: SimulateConfig | ReproduceConfig, controller: MannController
) -> NetworkState:
    """Initial weights of `draws` draws from number `initial.draw` on, (draws, *event)."""
    first, network = cfg.initial.draw, controller.network
    if first < 0:
        raise ConfigError(f"initial.draw = {first}: must be >= 0")
    if cfg.seed < 0:
        raise ConfigError(f"seed = {cfg.seed}: must be >= 0")
    if cfg.initial.weights_file is not None:
        V, b_v = inner_weights(
            cfg.initial.weights_file, network.n_inputs, network.n_hidden, first, cfg.draws
        )
        return network.from_inner_weights(V, b_v)
    states = []
    for draw in range(first, first + cfg.draws):
        # A draw's weights depend on seed and number alone, not on how many are drawn.
        generator = torch.Generator().manual_seed((cfg.seed << 20) + draw)
        states.append(network.initial_state((), generator))
    return NetworkState(*(torch.stack(leaf) for leaf in zip(*states, strict=True)))
