"""Ensembles of a configuration: scenarios times draws, with measurement noise of their own."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any, cast

import torch
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from mann_torch import MeasurementNoise
from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError
from mann_torch.tuning import Ensemble

from ..command.cli import compose_job
from ..command.conf_files import group_names
from ..settings.checks import check_horizon
from ..settings.config import SimulateConfig
from ..settings.study_config import NoiseConfig, StudyConfig, TuneConfig
from .batching import side_by_side
from .build import Experiment, build
from .sizes import check_noise


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


def with_start(plain: SimulateConfig, start: Any) -> SimulateConfig:
    """A scenario's configuration with some constants replaced. Raises `ConfigError`."""
    constants = dataclasses.asdict(plain.constants)
    if not isinstance(start, Mapping):
        raise ConfigError(f"start = {start}: give values by name, start={{rate_W:20}}")
    for name in start:
        if name not in constants:
            raise ConfigError(f"start: no constant '{name}'; choose from {', '.join(constants)}")
    try:
        merged = OmegaConf.merge(OmegaConf.structured(plain.constants), dict(start))
    except OmegaConfBaseException as error:
        raise ConfigError(f"start: {str(error).splitlines()[0]}") from None
    return dataclasses.replace(plain, constants=cast(Any, OmegaConf.to_object(merged)))


def experiment_of(cfg: StudyConfig, plain: SimulateConfig, draws: Sequence[int]) -> Experiment:
    """One scenario under the study's controller, with chosen draws. Raises `ConfigError`."""
    horizon = plain.scenario.horizon
    if cfg.horizon is not None:
        horizon = min(horizon, cfg.horizon)
    studied = dataclasses.replace(
        plain,
        controller=cfg.controller,
        keys=cfg.keys,
        memory=cfg.memory,
        solver=cfg.solver,
        initial=cfg.initial,
        seed=cfg.seed,
        horizon=horizon,
    )
    return build(studied, draws)


def ensemble_of(
    cfg: StudyConfig, scenarios: Sequence[SimulateConfig], draws: Sequence[int]
) -> Ensemble:
    """All pairs of scenario and draw as one ensemble. Raises `ConfigError`.

    Draw k has the same initial weights and the same noise in every scenario.
    """
    check_horizon(cfg.horizon)
    number("effort_after", cfg.effort_after, NONNEGATIVE)
    parts = [experiment_of(cfg, plain, draws) for plain in scenarios]
    scenario, weights, own = side_by_side(parts)
    first, noise = parts[0], _noise(cfg.noise, draws, scenario.end)
    if cfg.noise.position_std or cfg.noise.velocity_std:
        every = noise.select([place for _ in scenarios for place in range(len(draws))])
        scenario = dataclasses.replace(scenario, noise=every)
    return Ensemble(
        loop=first.loop,
        scenario=scenario,
        weights=weights,
        solver=first.solver,
        own=own,
        effort_after=cfg.effort_after,
        engine=cfg.solver.engine,
        device=cfg.solver.device,
    )


def _noise(cfg: NoiseConfig, draws: Sequence[int], end: float) -> MeasurementNoise:
    """Of each draw, checked though its standard deviations be 0. Raises `ConfigError`."""
    if not 0 <= cfg.seed < 1 << 62:
        raise ConfigError(f"noise.seed = {cfg.seed}: must be >= 0 and < 2^62")
    seeds = torch.tensor([cfg.seed + draw for draw in draws])
    noise = MeasurementNoise([cfg.position_std, cfg.velocity_std], seeds, cfg.rate)
    if cfg.rate is not None:
        check_noise(f"noise.rate = {cfg.rate:g}", cfg.rate * end, len(draws))
    return noise


def tuned_ensemble(cfg: TuneConfig, scenarios: Sequence[str], draws: Sequence[int]) -> Ensemble:
    """Named scenarios with the constants that tuning starts from. Raises `ConfigError`."""
    plains = [with_start(composed((f"scenario='{name}'",)), cfg.start or {}) for name in scenarios]
    return ensemble_of(cfg, plains, draws)
