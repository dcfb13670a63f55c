"""The plant of a configuration: its class, its parameters, where it starts."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from mann_torch.errors import ConfigError
from mann_torch.functional import as_float64
from mann_torch.plants import PLANTS, Plant

from .made import arguments, kind_of, made, mapping, named, unknown


def build_plant(node: Any) -> tuple[Plant, Any]:
    """The plant that is named, and its parameters. Raises `ConfigError`.

    What its constructor takes goes there; the rest are parameters, of which a number stands for a
    whole row.
    """
    settings = mapping("plant", node)
    name, kind = kind_of("plant", PLANTS, settings)
    given = arguments("plant", settings)
    takes = inspect.signature(kind).parameters
    plant: Plant = made("plant", kind, {k: v for k, v in given.items() if k in takes}, {})
    rows = {}
    for key, value in given.items():
        if key in takes:
            continue
        if key not in plant.fields:
            raise unknown("plant", key, name, [*plant.fields, *takes])
        width = as_float64(plant.fields[key].default).shape[-1]
        rows[key] = [value] * width if isinstance(value, int | float) else value
    return plant, named("plant", rows, lambda: plant.parameters_of(**rows))


def build_start(plant: Plant, node: Any) -> Any:
    """The plant's state at t = 0, fields that are not given at rest; None where none is.

    Raises `ConfigError`.
    """
    where = "scenario.start"
    given = arguments(where, mapping(where, node), ())
    if not given:
        return None
    rest = plant.rest()
    fields = dict(zip(rest._fields, rest, strict=True))
    rows = {name: _row(where, name, value, fields) for name, value in given.items()}
    return rest._replace(**rows)


def _row(where: str, name: str, value: Any, fields: Mapping[str, Tensor]) -> Tensor:
    if name not in fields:
        raise unknown(where, name, "the plant's state", fields)
    row: Tensor = named(where, (name,), lambda: as_float64(value, name))
    if row.dim() == 0:
        row = row.expand(fields[name].shape)
    if row.shape != fields[name].shape:
        raise ConfigError(f"{where}.{name} = {value}: give {fields[name].shape[-1]} numbers")
    if not bool(torch.isfinite(row).all()):
        raise ConfigError(f"{where}.{name} = {value}: must be finite")
    return row
