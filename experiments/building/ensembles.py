"""Ensembles of a configuration: scenarios times draws, with measurement noise of their own."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any, cast

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError
from mann_torch.tuning import Ensemble

from ..command.cli import compose_job
from ..command.conf_files import group_names
from ..command.hydra_setup import ONLY_SCENARIO
from ..settings.checks import check_horizon
from ..settings.config import LoopConfig, SimulateConfig
from ..settings.study_config import SetConfig, StudyConfig, TuneConfig
from .batching import side_by_side
from .build import build
from .controllers import constant


@functools.cache
def composed(overrides: tuple[str, ...]) -> SimulateConfig:
    """The `simulate` configuration of some overrides. Raises `ConfigError`."""
    return cast(SimulateConfig, OmegaConf.to_object(compose_job("simulate", list(overrides))))


def scenarios_of(cfg: TuneConfig, of: SetConfig) -> list[str]:
    """Names of a set's scenarios: the one that is chosen in their place, if any."""
    return of.scenarios if cfg.scenario is None else [cfg.scenario.name]


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


@functools.cache
def _named(scenario: str) -> dict[str, Any]:
    """What a scenario sets, and nothing else. Raises `ConfigError`."""
    alone = compose_job(ONLY_SCENARIO, [f"scenario='{scenario}'"])
    return cast(dict[str, Any], OmegaConf.to_container(alone))


def in_scenario(cfg: StudyConfig, name: str) -> SimulateConfig:
    """The study's loop in a named scenario: what the scenario sets comes before the study's.

    Raises `ConfigError`.
    """
    shared = {f.name: getattr(cfg, f.name) for f in dataclasses.fields(LoopConfig)}
    if isinstance(cfg, TuneConfig) and cfg.scenario is not None:  # no other is asked for
        return copy.deepcopy(SimulateConfig(**shared, scenario=cfg.scenario))
    study = OmegaConf.structured(SimulateConfig(**copy.deepcopy(shared)))
    try:
        return cast(SimulateConfig, OmegaConf.to_object(OmegaConf.merge(study, _named(name))))
    except OmegaConfBaseException as error:
        raise ConfigError(f"scenario '{name}': {str(error).splitlines()[0]}") from None


def with_start(plain: SimulateConfig, start: Any) -> SimulateConfig:
    """A scenario's configuration with some constants replaced. Raises `ConfigError`."""
    if not isinstance(start, Mapping):
        raise ConfigError(f"start = {start}: give values by name, start={{rate_W:20}}")
    for name, value in start.items():
        constant(f"start.{name}", value)
    return dataclasses.replace(plain, constants={**plain.constants, **start})


def ensemble_of(
    cfg: StudyConfig, scenarios: Sequence[SimulateConfig], draws: Sequence[int]
) -> Ensemble:
    """All pairs of scenario and draw as one ensemble. Raises `ConfigError`.

    Draw k has the same initial weights and the same noise in every scenario.
    """
    check_horizon(cfg.horizon)
    number("effort_after", cfg.effort_after, NONNEGATIVE)
    parts = []
    for plain in scenarios:
        horizon = plain.scenario.horizon
        if cfg.horizon is not None:
            horizon = min(horizon, cfg.horizon)
        parts.append(build(dataclasses.replace(plain, horizon=horizon), draws))
    scenario, weights, own = side_by_side(parts, len(draws))
    first = parts[0]
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


def tuned_ensemble(cfg: TuneConfig, scenarios: Sequence[str], draws: Sequence[int]) -> Ensemble:
    """Named scenarios with the constants that tuning starts from. Raises `ConfigError`."""
    plains = [with_start(in_scenario(cfg, name), cfg.start or {}) for name in scenarios]
    return ensemble_of(cfg, plains, draws)
