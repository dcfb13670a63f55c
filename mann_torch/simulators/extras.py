"""Simulators that are not part of an installation: found when they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ..errors import ConfigError


def extra(name: str) -> Any:
    """A package of the extra `simulators`. Raises `ConfigError`, in one line, if it is not here."""
    try:
        return import_module(name)
    except ImportError:
        raise ConfigError(f"{name} is not installed: pip install mann_torch[simulators]") from None
