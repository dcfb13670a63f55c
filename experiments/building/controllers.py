"""The controller of a configuration: the paper's kind, or any that is registered."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Mapping
from typing import Any, cast

import torch
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from torch import Tensor

from mann_torch import MannController
from mann_torch.control import (
    CONTROLLERS,
    LAWS,
    NETWORKS,
    Controller,
    FeatureNetwork,
    equal_parameter_hidden,
)
from mann_torch.errors import ConfigError
from mann_torch.memory import (
    ATTENTIONS,
    KEY_RULES,
    Attention,
    ReallocatingAttention,
    StateKeys,
    WorkingMemory,
)
from mann_torch.plants import Plant

from ..settings.checks import holds_truth
from ..settings.config import LoopConfig, MannConfig
from .made import arguments, kind_of, made, mapping, unknown

#: A controller of the paper's kind has these parts beside its own settings.
_PARTS = ("network", "law")
_OF_MANN = tuple(MannConfig.__dataclass_fields__)


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
    own = {k: v for k, v in cfg.controller.items() if k in _OF_MANN}
    try:
        merged = OmegaConf.merge(OmegaConf.structured(MannConfig), own)
        return cast(MannConfig, OmegaConf.to_object(merged))
    except OmegaConfBaseException as error:
        key, told = getattr(error, "full_key", ""), str(error).strip().splitlines()[0]
        raise ConfigError(f"controller.{key}: {told}") from None


def _attention(cfg: LoopConfig, settings: MannConfig) -> Attention | None:
    """The attention that is named, made with what else `controller` holds. Raises `ConfigError`."""
    given = arguments("controller", mapping("controller", cfg.controller), _OF_MANN)
    kind = None if settings.attention is None else ATTENTIONS[settings.attention]
    takes = [] if kind is None else [n for n in inspect.signature(kind).parameters if n != "phase"]
    for name in given:
        if name not in takes:
            raise unknown("controller", name, "a controller of this kind", [*_OF_MANN, *takes])
    return None if kind is None else made("controller", kind, given, {"phase": settings.phase})


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


def build_controller(cfg: LoopConfig, plant: Plant) -> Controller:
    """The controller for a plant, its constants at their defaults. Raises `ConfigError`."""
    kind = kind_name(cfg)
    if not is_mann(cfg):
        for name in _PARTS:
            if mapping(name, getattr(cfg, name)):
                raise ConfigError(f"{name}: controller kind '{kind}' has none; {name}=null")
        given = arguments("controller", mapping("controller", cfg.controller))
        sizes = {"n_inputs": len(plant.inputs), "n_outputs": len(plant.outputs)}
        controller: Controller = made("controller", CONTROLLERS[kind], given, sizes)
        return controller
    settings = mann_settings(cfg)
    n = len(plant.outputs)
    network = _network(cfg, n)
    n_hidden = hidden_neurons(cfg, n) if network is None else network.n_hidden
    memory, attention = None, _attention(cfg, settings)
    if attention is not None:
        memory = WorkingMemory(
            cfg.memory.n_slots,
            n_hidden,
            attention,
            made("keys", KEY_RULES[cfg.keys.name], {}, {}),
            context_width=n,
            reset=cfg.memory.reset,
        )
    if network is not None:
        return MannController(n, memory=memory, network=network)
    return MannController(n, n_hidden, memory, initial_std=cfg.initial.std)


def _network(cfg: LoopConfig, n: int) -> FeatureNetwork | None:
    """The network that is named, None for the paper's."""
    settings, of_law = mapping("network", cfg.network), mapping("law", cfg.law)
    if not settings:
        if of_law:
            raise ConfigError(
                "law: the paper's network has its own; choose network=radial_basis, or law=null"
            )
        return None
    _, kind = kind_of("network", NETWORKS, settings)
    given = arguments("network", settings)
    if of_law:
        _, law = kind_of("law", LAWS, of_law)
        given["law"] = made("law", law, arguments("law", of_law), {})
    # Centers lie in no box that would have to be known: by a normal law.
    sizes = {"n_inputs": 5 * n, "n_outputs": n, "n_hidden": hidden_neurons(cfg, n)}
    network: FeatureNetwork = made("network", kind, given, sizes)
    return network


@functools.cache
def paper_constants() -> frozenset[str]:
    """Names that some controller of the paper's has: one that lacks them does not use them."""
    memory = WorkingMemory(1, 1, ReallocatingAttention(), StateKeys(), context_width=1)
    return frozenset(MannController(1, 1, memory).constants())


def constant(where: str, value: Any) -> Tensor:
    """A constant's value as numbers. Raises `ConfigError`."""
    if value is None or isinstance(value, str | Mapping) or holds_truth(value):
        raise ConfigError(f"{where} = {value}: give a number, or rows of them")
    try:
        return torch.tensor(value, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise ConfigError(f"{where} = {value}: give a number, or rows of them") from None
