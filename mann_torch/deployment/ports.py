"""What a deployed controller is wired to: its numbers by name, in order, with their units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..control import Controller
from ..errors import ConfigError, DtypeError, ShapeError
from ..plants import Plant
from ..trees import map_tensors
from ..types import Channel, Measurement, ReferenceSample

#: What derivatives in time are called.
_DERIVATIVES = ("", " rate", " acceleration", " jerk", " snap")
#: Samples of the plant's state that tell which measured numbers are its outputs.
_PROBES = 3


class Ports(NamedTuple):
    """Numbers that go in and out at each tick, as two flat rows and one.

    The reference (R,) is p values, then their derivatives as far as `order`; the measurement (Y,)
    the fields of `measured` one after the other.
    """

    reference: tuple[Channel, ...]
    measurement: tuple[Channel, ...]
    input: tuple[Channel, ...]
    order: int  # derivatives of the reference
    measured: type  # NamedTuple that a controller takes
    widths: tuple[int, ...]  # of its fields
    #: Which measured numbers are the plant's outputs, None where not all of them are there.
    output: tuple[int, ...] | None

    @property
    def width(self) -> int:
        """Outputs that follow a reference, p."""
        return len(self.reference) // (self.order + 1)

    def sample(self, row: Tensor) -> ReferenceSample:
        """The reference of a row (R,)."""
        return ReferenceSample(*row.split(self.width, dim=-1))

    def seen(self, row: Tensor) -> Any:
        """The measurement of a row (Y,)."""
        return self.measured(*row.split(list(self.widths), dim=-1))

    def reference_row(self, given: Any, dtype: torch.dtype) -> Tensor:
        """A reference as a row (R,). Raises `ShapeError`, `DtypeError`, `KindError`."""
        if isinstance(given, ReferenceSample):
            given = given.upto(self.order)
        return _row("reference", given, len(self.reference), dtype)

    def measurement_row(self, given: Any, dtype: torch.dtype) -> Tensor:
        """A measurement as a row (Y,). Raises `ShapeError`, `DtypeError`, `KindError`."""
        return _row("measurement", given, len(self.measurement), dtype)


def ports_of(controller: Controller, plant: Plant | None, order: int) -> Ports:
    """Of a controller and its plant, or of one that knows its form alone (`Controller.form`).

    `order` derivatives of the reference are read. Raises `ConfigError`.
    """
    if plant is None:
        n = controller.form()
        if n is None:
            raise ConfigError(
                f"{type(controller).__name__} does not say alone what it measures: give deploy a "
                "plant (plant=...), or the ClosedLoop it runs in"
            )
        q = tuple(Channel(f"q_{i + 1}", "rad") for i in range(n))
        tau = tuple(Channel(f"tau_{i + 1}", "N m") for i in range(n))
        seen = _with_rates(q, 1)
        return Ports(_with_rates(q, order), seen, tau, order, Measurement, (n, n), tuple(range(n)))
    coefficients = plant.coefficients(plant.parameters_of())
    measured = plant.measure(plant.rest(), coefficients)
    widths = tuple(part.shape[-1] for part in measured)
    output = _outputs_among(plant, coefficients)
    return Ports(
        _with_rates(plant.outputs, order), _measured(plant, measured, output), tuple(plant.inputs),
        order, type(measured), widths, output,
    )  # fmt: skip


def _measured(plant: Plant, measured: Any, output: tuple[int, ...] | None) -> tuple[Channel, ...]:
    """Names of the numbers that are measured: outputs as the plant calls them, else by field."""
    names = [
        Channel(name if part.shape[-1] == 1 else f"{name}_{i + 1}", "")
        for name, part in zip(measured._fields, measured, strict=True)
        for i in range(part.shape[-1])
    ]
    for place, channel in zip(output or (), plant.outputs, strict=bool(output)):
        names[place] = channel
    if isinstance(measured, Measurement):
        n = measured.q.shape[-1]
        if n == len(plant.outputs):  # coordinates of their kind, if not they themselves
            names = [
                Channel(name, unit or other.unit)
                for (name, unit), other in zip(names[:n], plant.outputs, strict=True)
            ]
        names = list(_with_rates(names[:n], 1))
    return tuple(names)


def _with_rates(outputs: Sequence[Channel], order: int) -> tuple[Channel, ...]:
    """Channels of a reference and its derivatives."""
    return tuple(
        Channel(name + _DERIVATIVES[k], unit + ("" if k == 0 else "/s" if k == 1 else f"/s^{k}"))
        for k in range(order + 1)
        for name, unit in outputs
    )


def _outputs_among(plant: Plant, coefficients: Any) -> tuple[int, ...] | None:
    """Places of the plant's outputs among what is measured: those that agree on random states."""
    draw = torch.Generator().manual_seed(0)

    def shaken(x: Tensor) -> Tensor:
        return x + torch.randn(_PROBES, *x.shape, generator=draw, dtype=x.dtype)

    state = map_tensors(shaken, plant.rest())
    seen = torch.cat(list(plant.measure(state, coefficients)), dim=-1)
    wanted = plant.output(state, coefficients)
    places = []
    for column in wanted.unbind(-1):
        same = (seen == column.unsqueeze(-1)).all(dim=0).nonzero().flatten().tolist()
        if not same:
            return None
        places.append(int(same[0]))
    return tuple(places)


def _row(what: str, given: Any, width: int, dtype: torch.dtype) -> Tensor:
    """A row (width,) of a tensor, or of tensors one after the other."""
    if isinstance(given, tuple):
        parts = [instance(what, part, Tensor) for part in given if part is not None]
        given = torch.cat([part.reshape(-1) for part in parts])
    row = instance(what, given, Tensor)
    if row.shape != (width,):
        raise ShapeError(f"{what} has shape {tuple(row.shape)}, not ({width},)")
    if row.dtype != dtype:
        raise DtypeError(f"{what} is {row.dtype}: this stepper takes {dtype}")
    return row.detach()
