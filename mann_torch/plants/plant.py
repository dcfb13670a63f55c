"""The plant interface: d state/dt = f(t, state, input, disturbance, parameters)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from ..checks import sizes, text, whole, wrong
from ..domains import Domain
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64
from ..interface import Interface
from ..stiff import StiffBlock
from ..types import Channel, InputGains

# NamedTuples of tensors, each plant defines its own. Parameters (..., d) are what a user gives and
# a schedule moves; Coefficients are what the equations need, made from them once.
State = Any
Parameters = Any
Coefficients = Any
Measured = Any


class Input(NamedTuple):
    """Inputs of a plant that does not tell them apart."""

    u: Tensor  # (..., m)


class Field(NamedTuple):
    """A field of a plant's parameters: what its numbers are, and what they may be."""

    default: Numbers  # a row of numbers; its length is the field's width
    domain: Domain
    unit: str


class Plant(Interface, nn.Module):
    """Interface of every plant. Its contract (`mann_torch.testing.check_plant` holds one to it):

    1. State, parameters, inputs and measurement are NamedTuples of the plant's own; a field is
       (..., d), a row of numbers, `...` any batch dimensions.
    2. `inputs` and `outputs` name what goes in, m numbers, and what is to follow a reference, p
       numbers, with units: tables and pictures call them so. `disturbances` are what else acts on
       it, (..., k), a wind say; () for none.
    3. `derivative` depends on its arguments and on the module's own tensors alone, computes any
       batch at once, decides by `where`, and is float64.
    4. `fields` says which parameters there are, `Parameters` is their NamedTuple. `coefficients` is
       computed once while they are constant; the default are the parameters themselves.
    5. `rest` is the state, a row each, that a rollout starts from if it is given none.
    6. `linearized` gives a stiff block where stepping needs one; it may be approximate.
    """

    #: NamedTuple of the inputs: one field for all m numbers, or a field for each; else `grouped`.
    Input: ClassVar[type] = Input
    Parameters: ClassVar[type]
    required: ClassVar[Mapping[str, str]] = {
        "Parameters": "NamedTuple of the parameters' rows, a field for each of `fields`"
    }
    fields: Mapping[str, Field] = {}
    disturbances: tuple[Channel, ...] = ()

    @property
    @abstractmethod
    def inputs(self) -> tuple[Channel, ...]:
        """Names and units of the m numbers that go in."""

    @property
    @abstractmethod
    def outputs(self) -> tuple[Channel, ...]:
        """Names and units of the p numbers that are to follow a reference."""

    @abstractmethod
    def rest(self) -> State:
        """State that a rollout starts from if it is given none, a field (d,)."""

    @abstractmethod
    def derivative(
        self,
        t: Tensor,
        state: State,
        input: Any,
        disturbance: Tensor | None,
        coefficients: Coefficients,
    ) -> State:
        """Time derivative of the state at t (...,) [s], under `Input` and disturbances (..., k)."""

    @abstractmethod
    def output(self, state: State, coefficients: Coefficients) -> Tensor:
        """What is to follow the reference, (..., p)."""

    def measure(self, state: State, coefficients: Coefficients) -> Measured:
        """What a controller sees: a NamedTuple; the whole state here."""
        return state

    def coefficients(self, parameters: Any) -> Coefficients:
        """What the equations need, computed once while the parameters are constant."""
        return parameters

    def linearized(
        self,
        t: Tensor,
        state: State,
        input: Any,
        disturbance: Tensor | None,
        coefficients: Coefficients,
        gains: InputGains | None,
    ) -> tuple[State, StiffBlock | None]:
        """The derivative, and what is solved implicitly: nothing here.

        `gains` say how the input answers to the measurement, None where it is held.
        """
        return self.derivative(t, state, input, disturbance, coefficients), None

    def grouped(self, u: Tensor) -> Any:
        """Numbers (..., m) as the plant's `Input`."""
        names = self.Input._fields  # type: ignore[attr-defined]
        return self.Input(u) if len(names) == 1 else self.Input(*u.split(1, dim=-1))

    def parameters_of(self, **values: Numbers) -> Any:
        """Checked parameters from rows (..., d) by name; what is not given has its default.

        Raises `ConfigError` for an unknown name, `ShapeError`, `DomainError`, `KindError` or
        `DtypeError`.
        """
        for name in values:
            if name not in self.fields:
                raise ConfigError(f"no parameter '{name}' of {type(self).__name__}; {self._known}")
        rows = {name: values.get(name, field.default) for name, field in self.fields.items()}
        parameters = self.Parameters(*(as_float64(row, name) for name, row in rows.items()))
        self.check(parameters)
        return parameters

    def check(self, parameters: Any) -> None:
        """Raise as `parameters_of` does, for parameters or rows of a schedule."""
        if not all(hasattr(parameters, name) for name in self.fields):
            raise wrong("parameters", parameters, f"of {type(self).__name__}: {self._known}")
        for name, field in self.fields.items():
            rows, width = getattr(parameters, name), as_float64(field.default).shape[-1]
            if rows.dim() < 1 or rows.shape[-1] != width:
                raise ShapeError(
                    f"{name} has shape {tuple(rows.shape)}: give a row of {width}, (..., {width})"
                )
            field.domain.check(name, rows.detach())

    @property
    def _known(self) -> str:
        return f"choose from {', '.join(self.fields)}" if self.fields else "it has none"


def zeros(*widths: int) -> tuple[Tensor, ...]:
    """Rows of 0, for a plant at rest. Raises `KindError`."""
    return tuple(torch.zeros(n, dtype=torch.float64) for n in sizes("widths", widths))


def channels(prefix: str, count: int, unit: str) -> tuple[Channel, ...]:
    """`count` channels, numbered from 1. Raises `KindError`, `ConfigError`."""
    prefix, unit = text("prefix", prefix), text("unit", unit)
    return tuple(Channel(f"{prefix}_{i + 1}", unit) for i in range(whole("count", count)))
