"""Forms of what a plant gives: NamedTuples, rows, shapes against its channels, float64."""

from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from ..plants import Field, Plant
from ..trees import leaves
from ..types import Channel
from .forms import called, is_tree
from .functions import SAMPLES
from .plant_bench import Bench
from .telling import broken


def check_names(plant: Plant) -> None:
    """Channels, fields and the NamedTuples that are named."""
    for what in ("inputs", "outputs", "disturbances"):
        found = called(plant, 2, what, partial(getattr, plant, what))
        if not isinstance(found, tuple) or not all(isinstance(each, Channel) for each in found):
            raise broken(plant, 2, f"{what} = {found!r}", "give a tuple of Channel(name, unit)")
        names = [channel.name for channel in found]
        if len(set(names)) < len(names):
            raise broken(plant, 2, f"{what} have a name twice: {names}", "tables call them so")
        if not found and what != "disturbances":
            raise broken(plant, 2, f"{what} are empty", "name at least one channel")
    for what in ("Input", "Parameters"):
        kind = getattr(plant, what, None)
        if not (isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")):
            raise broken(plant, 1, f"{what} is no NamedTuple", "name the class that holds its rows")
    for name, field in plant.fields.items():
        if not isinstance(field, Field):
            raise broken(plant, 4, f"fields[{name!r}] is no Field", "give default, domain and unit")
    if plant.Parameters._fields != tuple(plant.fields):  # type: ignore[attr-defined]
        raise broken(
            plant,
            4,
            f"Parameters has {plant.Parameters._fields}, fields {tuple(plant.fields)}",  # type: ignore[attr-defined]
            "they must be the same names in the same order",
        )


def check_rest(plant: Plant) -> None:
    """A row a field."""
    rest = called(plant, 5, "rest()", plant.rest)
    if not is_tree(rest) or isinstance(rest, Tensor) or not leaves(rest):
        raise broken(
            plant, 5, "rest() is no NamedTuple of tensors", "a state is one, a row a field"
        )
    for leaf in leaves(rest):
        if leaf.dim() != 1 or leaf.dtype != torch.float64 or not bool(leaf.isfinite().all()):
            raise broken(
                plant,
                5,
                f"rest() has a field {tuple(leaf.shape)} of {leaf.dtype}",
                "each field is one row (d,) of finite float64 numbers",
            )


def check_forms(b: Bench) -> None:
    """Shapes and dtypes of what a plant computes, against its state and its channels."""
    plant = b.plant
    rate = called(plant, 3, "derivative of a batch of states", b.derivative)
    if type(rate) is not type(b.state):
        raise broken(
            plant,
            1,
            f"derivative gives a {type(rate).__name__}, the state is a {type(b.state).__name__}",
            "return the same NamedTuple",
        )
    _check_rows(plant, 3, "derivative", leaves(rate), [x.shape[-1] for x in leaves(b.state)])
    c = b.coefficients
    y = called(plant, 2, "output of a batch of states", lambda: plant.output(b.state, c))
    _check_rows(plant, 2, "output", [y], [len(plant.outputs)])
    seen = called(plant, 1, "measure of a batch of states", lambda: plant.measure(b.state, c))
    if not is_tree(seen) or isinstance(seen, Tensor) or not leaves(seen):
        raise broken(
            plant, 1, "measure gives no NamedTuple of tensors", "controllers read its fields"
        )
    _check_rows(plant, 1, "measure", leaves(seen), [x.shape[-1] for x in leaves(seen)])


def _check_rows(plant: Plant, line: int, what: str, rows: list[Tensor], widths: list[int]) -> None:
    if len(rows) != len(widths):
        raise broken(
            plant, line, f"{what} gives {len(rows)} tensors for {len(widths)}", "give one a field"
        )
    for row, width in zip(rows, widths, strict=True):
        if not isinstance(row, Tensor) or row.shape != (SAMPLES, width):
            raise broken(
                plant,
                line,
                f"{what} of {SAMPLES} samples has shape {tuple(row.shape)}",
                f"it must be (..., {width}) for any batch dimensions: here ({SAMPLES}, {width})",
            )
        if row.dtype != torch.float64:
            raise broken(
                plant, line, f"{what} is {row.dtype}", "this library computes in float64 only"
            )
        if not bool(row.isfinite().all()):
            raise broken(
                plant,
                line,
                f"{what} is not finite at random states about rest",
                "guard what divides or takes roots, or give `states` that make sense",
            )
