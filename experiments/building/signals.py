"""References and disturbances of a configuration, by name."""

from __future__ import annotations

import inspect
from typing import Any

from mann_torch.errors import ConfigError
from mann_torch.plants import Plant
from mann_torch.signals import REFERENCES, Disturbance, Forces, Reference
from mann_torch.trees import leaves

from .made import arguments, kind_of, made, mapping, unknown


def build_reference(where: str, node: Any, width: int) -> Reference:
    """The reference that is named, of `width` numbers. Raises `ConfigError`.

    A number, where its first argument is a row, stands for all `width` of them.
    """
    settings = mapping(where, node)
    _, kind = kind_of(where, REFERENCES, settings)
    given = arguments(where, settings)
    if "parts" in given:
        given["parts"] = _parts(f"{where}.parts", given["parts"], width)
    if "path" in given:  # of a file, in place of samples
        given = {k: v for k, v in given.items() if k not in ("times", "values")}
    first = next(iter(inspect.signature(kind).parameters), "")
    if isinstance(given.get(first), int | float) and not isinstance(given[first], bool):
        given[first] = [given[first]] * width
    reference: Reference = made(where, kind, given, {})
    return reference


def _parts(where: str, nodes: Any, width: int) -> list[Reference]:
    if not isinstance(nodes, list):
        raise ConfigError(f"{where} = {nodes}: give a list of references, each with a name")
    return [build_reference(f"{where}[{n}]", node, width) for n, node in enumerate(nodes)]


def build_disturbance(node: Any, plant: Plant, parameters: Any) -> Disturbance | None:
    """What disturbs the loop, None where nothing does. Raises `ConfigError`."""
    settings = arguments("disturbance", mapping("disturbance", node), ("name",))
    if not settings:
        return None
    rest = plant.rest()
    measured = plant.measure(rest, plant.coefficients(parameters))
    widths = {
        "input": len(plant.inputs),
        "output": sum(part.shape[-1] for part in measured),
        "state": sum(leaf.shape[-1] for leaf in leaves(rest)),
        "plant": len(plant.disturbances),
    }
    signals = {}
    for name, signal in settings.items():
        if name not in Forces._fields:
            raise unknown("disturbance", name, "a disturbance", Forces._fields)
        if widths[name] == 0:
            raise ConfigError(f"disturbance.{name}: {type(plant).__name__} names none of its own")
        where = f"disturbance.{name}"
        signals[name] = build_reference(where, signal, widths[name])
        if signals[name].width != widths[name]:
            raise ConfigError(
                f"{where} gives {signals[name].width} numbers, {type(plant).__name__} takes "
                f"{widths[name]} there"
            )
    return Disturbance(**signals)
