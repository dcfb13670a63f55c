"""Which kind of controller a configuration has, and what it says of the paper's."""

from __future__ import annotations

from typing import cast

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from mann_torch.control import CONTROLLERS, equal_parameter_hidden
from mann_torch.errors import ConfigError

from ..settings.config import LoopConfig, MannConfig
from ..settings.kinds import wrong_kind
from .made import mapping

OF_MANN = tuple(MannConfig.__dataclass_fields__)


def kind_name(cfg: LoopConfig) -> str:
    """Which kind of controller: the paper's where none is named. Raises `ConfigError`."""
    kind = mapping("controller", cfg.controller).get("kind", MannConfig.kind)
    if not isinstance(kind, str):
        raise ConfigError(f"controller.kind = {kind}: choose from {', '.join(CONTROLLERS)}")
    return kind


def is_mann(cfg: LoopConfig) -> bool:
    """Whether the controller is of the paper's kind."""
    return kind_name(cfg) == MannConfig.kind


def mann_settings(cfg: LoopConfig) -> MannConfig:
    """What `controller` says of the paper's kind. Raises `ConfigError`."""
    own = {k: v for k, v in cfg.controller.items() if k in OF_MANN}
    try:
        merged = OmegaConf.merge(OmegaConf.structured(MannConfig), own)
        return cast(MannConfig, OmegaConf.to_object(merged))
    except OmegaConfBaseException as error:
        key, told = getattr(error, "full_key", ""), str(error).strip().splitlines()[0]
        name = f"controller.{key}"
        raise ConfigError(wrong_kind(name, own.get(key), told) or f"{name}: {told}") from None


def hidden_neurons(cfg: LoopConfig, n: int) -> int:
    """N, given or such that the number of parameters equals that of a network with memory."""
    settings = mann_settings(cfg)
    if settings.n_hidden is not None:
        return settings.n_hidden
    slots, hidden = cfg.memory.n_slots, settings.matched_hidden
    if slots < 1 or hidden < 1:
        raise ConfigError(
            f"memory.n_slots = {slots}, controller.matched_hidden = {hidden}: at least 1"
        )
    return equal_parameter_hidden(5 * n, n, hidden, slots)
