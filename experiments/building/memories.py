"""The working memory of a configuration, for whatever controller takes one."""

from __future__ import annotations

import inspect
from typing import Any

from mann_torch.checks import choice, whole
from mann_torch.errors import ConfigError
from mann_torch.memory import ATTENTIONS, KEY_RULES, WorkingMemory
from mann_torch.memory.working_memory import RESETS

from ..settings.config import LoopConfig, MannConfig
from .made import MOST, kind_of, made


def attention_takes(settings: MannConfig) -> list[str]:
    """What the attention that is named is told beside its phase."""
    if settings.attention is None:
        return []
    taken = inspect.signature(ATTENTIONS[settings.attention]).parameters
    return [name for name in taken if name != "phase"]


def check_slots(cfg: LoopConfig) -> None:
    """Check what a memory is told, where a controller has none too. Raises `ConfigError`."""
    if whole("memory.n_slots", cfg.memory.n_slots) > MOST:
        raise ConfigError(f"memory.n_slots = {cfg.memory.n_slots}: at most {MOST}")
    choice("memory.reset", cfg.memory.reset, RESETS)
    kind_of("keys", KEY_RULES, {"name": cfg.keys.name})


def build_memory(
    cfg: LoopConfig, settings: MannConfig, given: dict[str, Any], n_hidden: int, width: int
) -> WorkingMemory | None:
    """The memory, if there is attention to it; None otherwise. Raises `ConfigError`.

    `given` is what `controller` says beside its settings, of which the attention takes its own out.
    `width` numbers are what state keys compare.
    """
    choice("memory.reset", cfg.memory.reset, RESETS)  # without a memory, too
    if settings.attention is None:
        return None
    own = {name: given.pop(name) for name in attention_takes(settings) if name in given}
    return WorkingMemory(
        cfg.memory.n_slots,
        n_hidden,
        made("controller", ATTENTIONS[settings.attention], own, {"phase": settings.phase}),
        made("keys", KEY_RULES[cfg.keys.name], {}, {}),
        context_width=width,
        reset=cfg.memory.reset,
    )
