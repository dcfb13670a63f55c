"""Linear plants, from matrices or from a transfer function."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import choice
from ..domains import Finite
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64, times_column
from ..stiff import FirstOrderBlock
from ..types import Channel, InputGains
from .first_order import MeasuredOutput, RowState
from .plant import Field, Input, Plant, channels, zeros


class LinearParameters(NamedTuple):
    """The matrices, row after row."""

    A: Tensor  # (..., d * d) [1/s]
    B: Tensor  # (..., d * m)
    C: Tensor  # (..., p * d)


class LinearCoefficients(NamedTuple):
    """The matrices."""

    A: Tensor  # (..., d, d)
    B: Tensor  # (..., d, m)
    C: Tensor  # (..., p, d)


class LinearPlant(Plant):
    """dx/dt = A x + B u, y = C x, with d states, m inputs and p outputs.

    A (d, d), B (d, m) and C (p, d) fix the sizes and are the defaults of the parameters, whose rows
    are the matrices' rows one after the other: they may differ by sample and change in time. A
    controller sees the output, or with `measured` = "state" the state. Raises `ShapeError`,
    `DomainError`, `KindError`, `DtypeError` or `ConfigError`.
    """

    Parameters = LinearParameters

    def __init__(self, A: Numbers, B: Numbers, C: Numbers, measured: str = "output") -> None:
        super().__init__()
        parts = {"A": _matrix("A", A), "B": _matrix("B", B), "C": _matrix("C", C)}
        d, m, p = len(parts["A"]), parts["B"].shape[1], len(parts["C"])
        for name, shape in {"A": (d, d), "B": (d, m), "C": (p, d)}.items():
            if tuple(parts[name].shape) != shape:
                raise ShapeError(
                    f"{name} has shape {tuple(parts[name].shape)}; A (d, d), B (d, m) and C (p, d) "
                    f"go together, and A has d = {d} rows: {name} must be {shape}"
                )
        self._sizes = d, m, p
        self.measured = choice("measured", measured, ("output", "state"))
        units = {"A": "1/s", "B": "1/s", "C": "-"}
        domain = Finite()
        self.fields = {
            name: Field(domain.check(name, part).flatten(), domain, units[name])
            for name, part in parts.items()
        }

    @staticmethod
    def from_transfer_function(
        numerator: Numbers, denominator: Numbers, measured: str = "output"
    ) -> LinearPlant:
        """y = numerator(s) / denominator(s) u, in controllable canonical form.

        Raises as `controllable_form`, and `ConfigError` or `KindError` for `measured`.
        """
        return LinearPlant(*controllable_form(numerator, denominator), measured)

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """u."""
        return channels("u", self._sizes[1], "-")

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """y."""
        return channels("y", self._sizes[2], "-")

    def coefficients(self, parameters: LinearParameters) -> LinearCoefficients:
        """Matrices from rows."""
        d, m, p = self._sizes
        A, B, C = parameters
        return LinearCoefficients(
            A.unflatten(-1, (d, d)), B.unflatten(-1, (d, m)), C.unflatten(-1, (p, d))
        )

    def rest(self) -> RowState:
        """x = 0."""
        return RowState(*zeros(self._sizes[0]))

    def output(self, state: RowState, coefficients: LinearCoefficients) -> Tensor:
        """y (..., p)."""
        return times_column(coefficients.C, state.x)

    def measure(self, state: RowState, coefficients: LinearCoefficients) -> object:
        """y, or the state."""
        if self.measured == "state":
            return state
        return MeasuredOutput(self.output(state, coefficients))

    def derivative(
        self,
        t: Tensor,
        state: RowState,
        input: Input,
        disturbance: Tensor | None,
        coefficients: LinearCoefficients,
    ) -> RowState:
        """A x + B u (..., d)."""
        A, B, _ = coefficients
        return RowState(times_column(A, state.x) + times_column(B, input.u))

    def linearized(
        self,
        t: Tensor,
        state: RowState,
        input: Input,
        disturbance: Tensor | None,
        coefficients: LinearCoefficients,
        gains: InputGains | None,
    ) -> tuple[RowState, FirstOrderBlock]:
        """The derivative and A - B K C with the controller's gains K, A where the input is held."""
        A, B, C = coefficients
        rate = self.derivative(t, state, input, disturbance, coefficients)
        if gains is None:
            return rate, FirstOrderBlock(A, torch.zeros_like(rate.x))
        seen = gains.measurement if self.measured == "state" else gains.measurement @ C
        return rate, FirstOrderBlock(A - B @ seen, times_column(B, gains.drift))


def controllable_form(numerator: Numbers, denominator: Numbers) -> tuple[Tensor, Tensor, Tensor]:
    """A (d, d), B (d, 1) and C (1, d) of a strictly proper transfer function.

    Coefficients from the highest power of s down. Raises `ConfigError` where the numerator's degree
    is not below the denominator's, `ShapeError`, `KindError` or `DtypeError`.
    """
    above, below = _polynomial("numerator", numerator), _polynomial("denominator", denominator)
    d = len(below) - 1
    if len(above) > d:
        raise ConfigError(
            f"numerator has degree {len(above) - 1} and denominator degree {d}: the transfer "
            "function is not strictly proper, the output would hold a part of the input itself; "
            "the numerator's degree must be lower"
        )
    row = (below / below[0])[1:].flip(0)
    A = torch.cat([torch.eye(d, dtype=torch.float64)[1:], -row.unsqueeze(0)])
    B = torch.eye(d, dtype=torch.float64)[:, -1:]
    C = torch.nn.functional.pad((above / below[0]).flip(0), (0, d - len(above))).unsqueeze(0)
    return A, B, C


def _matrix(name: str, value: Numbers) -> Tensor:
    matrix = as_float64(value, name)
    if matrix.dim() != 2 or 0 in matrix.shape:
        raise ShapeError(f"{name} has shape {tuple(matrix.shape)}; give a matrix, rows of numbers")
    return matrix


def _polynomial(name: str, value: Numbers) -> Tensor:
    """Coefficients (k,) without leading zeros."""
    row = Finite().check(name, as_float64(value, name))
    if row.dim() != 1:
        raise ShapeError(f"{name} has shape {tuple(row.shape)}; give a row of coefficients")
    present = row.detach().nonzero()
    if not len(present):
        raise ConfigError(f"{name} = {row.tolist()}: one coefficient at least must not be 0")
    return row[int(present[0]) :]
