"""Ensembles of a configuration: scenarios times draws, with measurement noise of their own."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import torch
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from mann_torch import MeasurementNoise
from mann_torch.errors import ConfigError
from mann_torch.tuning import Ensemble
from mann_torch.types import NetworkState

from .batching import side_by_side
from .build import Experiment, build
from .cli import compose_job
from .config import ConstantsConfig, SimulateConfig
from .hydra_setup import group_names
from .study_config import StudyConfig


@dataclass(frozen=True)
class Member:
    """Which scenario and draw a member is."""

    scenario: str
    draw: int


@functools.cache
def composed(overrides: tuple[str, ...]) -> SimulateConfig:
    """The `simulate` configuration of some overrides. Raises `ConfigError`."""
    return cast(SimulateConfig, OmegaConf.to_object(compose_job("simulate", list(overrides))))


def check_names(where: str, scenarios: Sequence[str], draws: Sequence[int]) -> None:
    """Raise `ConfigError` for an empty list, an unknown scenario or a draw < 0."""
    known = group_names("scenario")
    for name, given in (("scenarios", scenarios), ("draws", draws)):
        if not given:
            raise ConfigError(f"{where}.{name} is empty: give at least one")
        if len(set(given)) < len(given):
            raise ConfigError(f"{where}.{name} = {list(given)}: each once")
    for scenario in scenarios:
        if scenario not in known:
            raise ConfigError(
                f"{where}.scenarios: unknown name '{scenario}'; choose from {', '.join(known)}"
            )
    if min(draws) < 0:
        raise ConfigError(f"{where}.draws = {list(draws)}: must be >= 0")


def experiment_of(cfg: StudyConfig, scenario: str, draws: Sequence[int]) -> Experiment:
    """One scenario with chosen draws of the initial weights. Raises `ConfigError`."""
    plain = composed((f"scenario='{scenario}'", f"controller={cfg.controller}", f"keys={cfg.keys}"))
    constants = dataclasses.asdict(plain.constants)
    for name, value in cfg.start.items():
        if name not in constants:
            raise ConfigError(f"start: no constant '{name}'; choose from {', '.join(constants)}")
        constants[name] = value
    horizon = plain.scenario.horizon
    if cfg.horizon is not None:
        horizon = min(horizon, cfg.horizon)
    try:
        typed = OmegaConf.to_object(OmegaConf.structured(type(plain.constants)(**constants)))
    except OmegaConfBaseException as error:
        raise ConfigError(f"start: {str(error).splitlines()[0]}") from None
    made = build(
        dataclasses.replace(
            plain,
            constants=cast(ConstantsConfig, typed),
            memory=cfg.memory,
            solver=cfg.solver,
            initial=cfg.initial,
            draws=max(draws) + 1,
            seed=cfg.seed,
            horizon=horizon,
        )
    )
    chosen = list(draws)
    network = NetworkState(*(leaf[chosen] for leaf in made.network))
    return dataclasses.replace(made, network=network)


def ensemble_of(
    cfg: StudyConfig, scenarios: Sequence[str], draws: Sequence[int]
) -> tuple[Ensemble, list[Member]]:
    """All pairs of scenario and draw as one ensemble. Raises `ConfigError`.

    Draw k has the same initial weights and the same noise in every scenario.
    """
    parts = [experiment_of(cfg, scenario, draws) for scenario in scenarios]
    scenario, network, own = side_by_side(parts)
    members = [Member(name, draw) for name in scenarios for draw in draws]
    noise, first = cfg.noise, parts[0]
    if noise.position_std or noise.velocity_std:
        seeds = torch.tensor([noise.seed + member.draw for member in members])
        scenario = dataclasses.replace(
            scenario,
            noise=MeasurementNoise(noise.position_std, noise.velocity_std, seeds, noise.rate),
        )
    ensemble = Ensemble(
        loop=first.loop,
        scenario=scenario,
        network=network,
        solver=first.solver,
        own=own,
        effort_after=cfg.effort_after,
        engine=cfg.solver.engine,
        device=cfg.solver.device,
    )
    return ensemble, members
