"""The adaptive law of a configuration: composed of mechanisms, or any that is registered."""

from __future__ import annotations

from typing import Any

from mann_torch.control import LAW_PARTS, LAWS, AdaptiveLaw, Law

from .made import arguments, kind_of, made, mapping, unknown


def build_law(where: str, node: Any) -> Law | None:
    """The law that is named; None where nothing is.

    Of an adaptive one each key is a mechanism, its value what that is told; null leaves it out.
    Raises `ConfigError`.
    """
    settings = mapping(where, node)
    if not settings:
        return None
    name, kind = kind_of(where, LAWS, settings)
    given = arguments(where, settings, ("name",))
    if kind is not AdaptiveLaw:
        law: Law = made(where, kind, given, {})
        return law
    parts = []
    for key, value in given.items():
        if key not in LAW_PARTS:
            raise unknown(where, key, f"law '{name}'", LAW_PARTS)
        told = arguments(f"{where}.{key}", mapping(f"{where}.{key}", value), ())
        parts.append(made(f"{where}.{key}", LAW_PARTS[key], told, {}))
    return AdaptiveLaw(*parts)
