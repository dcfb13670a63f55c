"""All that the settings of a loop lead to, to be compared with what others would."""

from __future__ import annotations

import dataclasses
from typing import Any, cast

from omegaconf import OmegaConf

from ..settings.config import LoopConfig, ScenarioLoopConfig, SimulateConfig, title_of
from ..settings.study_config import TuneConfig
from .build import build
from .ensembles import in_scenario

#: The nodes that it shows the settings of.
LOOP_NODES = tuple(field.name for field in dataclasses.fields(ScenarioLoopConfig))


def what_runs(cfg: Any) -> object:
    """Of a composed configuration, with one draw; None where it takes another's settings.

    Raises `ConfigError`.
    """
    plain = cast(LoopConfig, OmegaConf.to_object(cfg))
    asked = {k: v for k, v in vars(plain).items() if k not in LOOP_NODES}
    if isinstance(plain, TuneConfig):
        if plain.resume is not None:
            return None
        names = [*plain.train.scenarios, *plain.held_out.scenarios]
        loops = [in_scenario(plain, name) for name in names]
    else:
        shared = {name: getattr(plain, name) for name in LOOP_NODES}
        loops = [SimulateConfig(**shared)]
    return asked, [(title_of(loop), loop.seed, build(loop, [0])) for loop in loops]
