"""What a configuration's controller adapts: a network, linear in features of a basis or not."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from mann_torch.control import (
    BASES,
    NETWORKS,
    Basis,
    FeatureNetwork,
    FunctionBasis,
    Law,
    LinearNetwork,
)
from mann_torch.errors import ConfigError
from mann_torch.plants import Plant

from .made import arguments, kind_of, made, mapping

#: The basis that a plant has of its own, as wing rock's moment.
OF_PLANT = "plant"


def build_network(
    node: Any, law: Law | None, plant: Plant, sizes: dict[str, int]
) -> FeatureNetwork | None:
    """The network that is named, of `sizes` n_inputs, n_outputs and n_hidden; None for the paper's.

    Raises `ConfigError`, for a law that it has no use for too.
    """
    settings = mapping("network", node)
    if not settings:
        return None
    _, kind = kind_of("network", NETWORKS, settings)
    given = arguments("network", settings)
    supplied: dict[str, Any] = dict(sizes)
    if issubclass(kind, LinearNetwork):
        given["basis"] = _basis(given.get("basis"), plant, sizes)
        supplied["law"] = law
    elif law is not None:
        supplied["law_W"] = law
    if "start" in given and isinstance(given["start"], list):
        given["start"] = _rows(given["start"], sizes["n_outputs"])
    network: FeatureNetwork = made("network", kind, given, supplied)
    return network


def _rows(start: list[Any], n_outputs: int) -> list[Any]:
    """A list of N numbers stands for one column."""
    column = n_outputs == 1 and not any(isinstance(x, list) for x in start)
    return [[x] for x in start] if column else start


def _basis(node: Any, plant: Plant, sizes: dict[str, int]) -> Basis:
    where = "network.basis"
    settings = mapping(where, node)
    if settings.get("name") == OF_PLANT:
        return _of_plant(where, plant, sizes["n_inputs"])
    _, kind = kind_of(where, BASES, settings)
    # Centers lie in no box that would have to be known: by a normal law.
    given = arguments(where, settings)
    if "path" in given:  # of a file, in place of random ones
        given = {"path": given["path"]}
    basis: Basis = made(where, kind, given, sizes)
    return basis


def _of_plant(where: str, plant: Plant, n_inputs: int) -> Basis:
    """Of the numbers that a plant measures, which come first in z."""
    own = getattr(plant, "basis", None)
    if own is None:
        raise ConfigError(f"{where}: {type(plant).__name__} names no features of its own")
    rest = plant.rest()
    width = sum(math.prod(leaf.shape) for leaf in rest)

    def of_state(z: Tensor) -> Tensor:
        found: Tensor = own(z[..., :width])
        return found

    count = of_state(torch.zeros(n_inputs, dtype=torch.float64)).shape[-1]
    return FunctionBasis(of_state, n_inputs, count)
