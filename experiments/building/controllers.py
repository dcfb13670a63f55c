"""The controller of a configuration: the paper's kind, or any that is registered."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from mann_torch import MannController
from mann_torch.control import Controller, Readouts
from mann_torch.errors import ConfigError
from mann_torch.memory import ReallocatingAttention, StateKeys, WorkingMemory
from mann_torch.plants import Plant

from ..settings.checks import holds_truth
from ..settings.config import LoopConfig
from .controller_kinds import OF_MANN, hidden_neurons, is_mann, mann_settings
from .laws import build_law
from .made import arguments, mapping, unknown
from .memories import attention_takes, build_memory
from .networks import build_network
from .other_controllers import build_other, nested


def build_controller(cfg: LoopConfig, plant: Plant) -> Controller:
    """The controller for a plant, its constants at their defaults. Raises `ConfigError`."""
    if not is_mann(cfg):
        return build_other(cfg, plant)
    settings = mann_settings(cfg)
    n = len(plant.outputs)
    law = build_law("law", cfg.law)
    sizes = {"n_inputs": 5 * n, "n_outputs": n, "n_hidden": hidden_neurons(cfg, n)}
    network = build_network(cfg.network, law, plant, sizes)
    if network is None and law is not None:
        raise ConfigError("law: the paper's network has its own; choose a network, or law=null")
    n_hidden = sizes["n_hidden"] if network is None else network.n_hidden
    given = arguments("controller", mapping("controller", cfg.controller), OF_MANN)
    takes = [*attention_takes(settings), "readouts"]
    for name in given:
        if name not in takes:
            raise unknown("controller", name, "a controller of this kind", [*OF_MANN, *takes])
    memory = build_memory(cfg, settings, given, n_hidden, n)
    readouts = given.get("readouts")
    if readouts is not None:
        readouts = nested("controller.readouts", Readouts, readouts)
    if network is not None:
        return MannController(n, memory=memory, network=network, readouts=readouts)
    return MannController(n, n_hidden, memory, initial_std=cfg.initial.std, readouts=readouts)


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
