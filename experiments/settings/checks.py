"""Checks of plain settings, each a `ConfigError` that names the setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mann_torch.checks import POSITIVE, number
from mann_torch.errors import ConfigError


def check_between(cfg: Any, limits: Mapping[str, tuple[int, int]], where: str = "") -> None:
    """Raise `ConfigError` for a setting outside its least and largest value."""
    for name, (least, most) in limits.items():
        value = getattr(cfg, name)
        if not least <= value <= most:
            raise ConfigError(f"{where}{name} = {value}: must be {least} to {most}")


def check_positive(name: str, value: float) -> None:
    """Raise `ConfigError` for a number that is not finite and > 0."""
    number(name, value, POSITIVE)


def check_horizon(horizon: float | None) -> None:
    """Raise `ConfigError` for a horizon [s] that is given and not finite and > 0."""
    if horizon is not None:
        check_positive("horizon", horizon)


def holds_truth(value: Any) -> bool:
    """Whether true or false stands somewhere in a number, a list or a list of lists."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return any(holds_truth(inner) for inner in value)
    return isinstance(value, bool)


def check_variants(chosen: Sequence[str], known: Sequence[str], what: str = "variant") -> None:
    """Raise `ConfigError` for no variant, an unknown one or one twice."""
    for name in chosen:
        if name not in known:
            raise ConfigError(f"unknown {what} '{name}'; choose from {', '.join(known)}")
    if not chosen or len(set(chosen)) < len(chosen):
        raise ConfigError(f"{what}s = {list(chosen)}: name each once, at least one")
