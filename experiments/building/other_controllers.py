"""Controllers of any kind but the paper's: their parts, and what they take of the plant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mann_torch.control import (
    CONTROLLERS,
    LABELS,
    SATURATIONS,
    BoundaryLayer,
    Controller,
    IntegralAction,
    Readouts,
)
from mann_torch.errors import ConfigError
from mann_torch.plants import MechanicalPlant, Plant
from mann_torch.registry import Registry

from ..settings.config import LoopConfig
from .controller_kinds import kind_name, mann_settings
from .laws import build_law
from .made import arguments, every_argument, kind_of, made, mapping
from .memories import build_memory, check_slots
from .networks import build_network
from .plants import build_plant

#: Nodes within `controller` that are parts of it: of one class, or of a registry, by name.
NESTED: dict[str, Any] = {
    "robust": BoundaryLayer,
    "integral": IntegralAction,
    "saturation": SATURATIONS,
    "labels": LABELS,
    "readouts": Readouts,
}
#: What a memory is told, within `controller`.
_OF_MEMORY = ("attention", "phase")
#: What is adapted where nothing is said: gains on what is fed in.
IDENTITY = {"name": "linear", "basis": {"name": "identity"}}
_N_HIDDEN = 10


def build_other(cfg: LoopConfig, plant: Plant) -> Controller:
    """What is named, with what its constructor takes of plant, network, law and memory.

    Raises `ConfigError`.
    """
    check_slots(cfg)
    where, name = "controller", kind_name(cfg)
    kind = CONTROLLERS[name]
    takes = every_argument(kind)
    for part in ("network", "law"):
        if mapping(part, getattr(cfg, part)) and not takes & {part, "network"}:
            raise ConfigError(f"{part}: controller kind '{name}' has none; {part}=null")
    given = arguments(where, mapping(where, cfg.controller))
    for key, of in NESTED.items():
        if key in takes and isinstance(given.get(key), Mapping):
            given[key] = nested(f"{where}.{key}", of, given[key])
    supplied = _of_plant(cfg, plant, takes, given)
    law = build_law("law", cfg.law)
    if "network" in takes:
        supplied |= _adaptation(cfg, plant, kind, given, law, supplied["n_measured"])
    elif law is not None:
        supplied["law"] = law
    controller: Controller = made(where, kind, given, supplied)
    return controller


def nested(where: str, of: Any, node: Any) -> Any:
    """A part of a controller, from arguments, or a name and arguments."""
    settings = mapping(where, node)
    kind = kind_of(where, of, settings)[1] if isinstance(of, Registry) else of
    return made(where, kind, arguments(where, settings), {})


def _adaptation(
    cfg: LoopConfig, plant: Plant, kind: Any, given: dict[str, Any], law: Any, measured: int
) -> dict[str, Any]:
    """Network and memory of a controller; what `controller` says of them is taken out of `given`.

    State keys compare all that is measured.
    """
    sizes = {
        "n_inputs": kind.fed(len(plant.outputs), measured, given),
        "n_outputs": len(plant.inputs),
        "n_hidden": given.pop("n_hidden", _N_HIDDEN),
    }
    network = build_network(mapping("network", cfg.network) or IDENTITY, law, plant, sizes)
    if network is None:
        return {}
    settings = mann_settings(cfg)
    memory = build_memory(cfg, settings, given, network.n_hidden, measured)
    for name in _OF_MEMORY:
        given.pop(name, None)
    return {"network": network} | ({} if memory is None else {"memory": memory})


def _of_plant(
    cfg: LoopConfig, plant: Plant, takes: set[str], given: dict[str, Any]
) -> dict[str, Any]:
    """Sizes, and the equations that the controller believes in: `nominal` rows are its own."""
    coefficients = plant.coefficients(build_plant(cfg.plant)[1])
    measured = plant.measure(plant.rest(), coefficients)
    label = getattr(given.get("labels"), "field", None)
    of_state = [name for name in measured._fields if name != label]
    supplied: dict[str, Any] = {
        "n_inputs": len(plant.inputs),
        "n_outputs": len(plant.outputs),
        "n_joints": len(plant.outputs),
        "n_measured": sum(getattr(measured, name).shape[-1] for name in of_state),
    }
    if "mechanics" not in takes:
        return supplied
    if not isinstance(plant, MechanicalPlant):
        raise ConfigError(
            f"controller '{cfg.controller.get('name')}' takes the equations of a mechanical "
            f"plant, and '{cfg.plant['name']}' is none"
        )
    believed = mapping("controller.nominal", given.pop("nominal", None))
    parameters = build_plant({**cfg.plant, **believed})[1]
    return supplied | {"mechanics": plant, "parameters": parameters}
