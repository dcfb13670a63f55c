"""Reference models: parts with a state that turn a command into what the plant is to follow."""

from __future__ import annotations

from abc import abstractmethod

import torch
from torch import Tensor

from ..checks import number, whole
from ..constraints import DesignModule, FiniteRow, PositiveRow
from ..errors import DomainError, ShapeError
from ..functional import Numbers, as_float64, times_column
from ..interface import Interface
from ..types import MOST_DERIVATIVES, ReferenceSample


class ReferenceModel(Interface, DesignModule):
    """Interface of every reference model. Its contract (`mann_torch.testing.check_model`):

    1. Its state is a tensor (..., d); it flows with the loop.
    2. `rates` (..., d) may depend on the plant's output: a closed-loop reference model.
    3. `sample` is what the controller follows: the model's output (..., p), with `order`
       derivatives in time, as state and command move, and command and state beside it. The tracking
       error is that of this output.
    4. It reads the command's value, and no more than `command_order` of its derivatives.
    5. It is a function of its arguments and of declared constants alone, for any batch at once,
       decided by `where`, in float64. Gradients reach them all.
    """

    #: Numbers of command and output, p.
    width: int
    order: int = 1
    command_order: int = 0

    @abstractmethod
    def initial_state(self, command: ReferenceSample, output: Tensor) -> Tensor:
        """State (..., d) at t = 0, at the plant's output (..., p)."""

    @abstractmethod
    def rates(self, command: ReferenceSample, output: Tensor, state: Tensor) -> Tensor:
        """Time derivative of the state (..., d)."""

    @abstractmethod
    def sample(self, command: ReferenceSample, output: Tensor, state: Tensor) -> ReferenceSample:
        """What the controller follows."""


class LinearModel(ReferenceModel):
    """x_m' = A x_m + B r + L (y - C x_m), y_m = C x_m.

    `A` (d, d), `B` (d, p), `C` (p, d; the identity if not given). `observer_gain` L (d, p) makes it
    a closed-loop reference model (Gibson et al., arXiv 1304.7278). `start` (d,) is x_m(0), 0 if not
    given. It has as many derivatives as the command does not enter but by the last: its relative
    degree, at most 4. Constants: `A`, `B`, `C` and `observer_gain`, each row by row in one row of
    numbers.

    Raises `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        A: Numbers,
        B: Numbers,
        C: Numbers | None = None,
        observer_gain: Numbers | None = None,
        start: Numbers | None = None,
    ) -> None:
        super().__init__()
        A, B = as_float64(A, "A"), as_float64(B, "B")
        if A.dim() != 2 or A.shape[0] != A.shape[1] or B.dim() != 2 or len(B) != len(A):
            raise ShapeError(
                f"A of shape {tuple(A.shape)} and B of {tuple(B.shape)}: give (d, d) and (d, p)"
            )
        self.size, self.width = B.shape
        C = torch.eye(self.size, dtype=A.dtype) if C is None else as_float64(C, "C")
        self._declare("A", A, (self.size, self.size))
        self._declare("B", B, (self.size, self.width))
        self._declare("C", C, (self.width, self.size))
        self.closed = observer_gain is not None
        into = [B] if observer_gain is None else [B, as_float64(observer_gain, "observer_gain")]
        self.order = _relative_degree(A, into, C)
        if observer_gain is not None:
            gain = as_float64(observer_gain, "observer_gain")
            self._declare("observer_gain", gain, (self.size, self.width))
        given = [0.0] * self.size if start is None else start
        rows = FiniteRow().check("start", as_float64(given, "start"))
        if rows.shape != (self.size,):
            raise ShapeError(f"start of shape {tuple(rows.shape)}: give {self.size} numbers")
        self.start: Tensor
        self.register_buffer("start", rows.detach())

    @classmethod
    def first_order(cls, rate: float, gain: float = 1.0, start: float = 0.0) -> LinearModel:
        """x_m' = -rate x_m + rate gain r, of one output: gain rate/(s + rate).

        Raises `ConfigError` or `KindError`.
        """
        rate, gain, start = number("rate", rate), number("gain", gain), number("start", start)
        return cls([[-rate]], [[rate * gain]], start=[start])

    def _declare(self, name: str, value: Tensor, shape: tuple[int, int]) -> None:
        if value.shape != shape:
            raise ShapeError(f"{name} of shape {tuple(value.shape)}: give {shape}")
        self.declare(name, value.reshape(-1), FiniteRow(), (value.numel(),))

    def _matrix(self, name: str) -> Tensor:
        rows: Tensor = getattr(self, name)
        width = self.width if name in ("B", "observer_gain") else self.size
        return rows.unflatten(-1, (-1, width))

    def check_together(self) -> None:
        """Raise `DomainError` where matrices that were set later have a lower relative degree."""
        into = [self._matrix(name) for name in ("B", "observer_gain") if hasattr(self, name)]
        found = _relative_degree(self._matrix("A"), into, self._matrix("C"))
        if found < self.order:
            raise DomainError(
                f"A, B and C have relative degree {found}, the model was made with {self.order}: "
                "its derivatives would lack the command's; make a new one"
            )

    def initial_state(self, command: ReferenceSample, output: Tensor) -> Tensor:
        """`start` (..., d)."""
        return self.start.expand(*output.shape[:-1], self.size)

    def rates(self, command: ReferenceSample, output: Tensor, state: Tensor) -> Tensor:
        """A x_m + B r + L (y - y_m), (..., d)."""
        rate = times_column(self._matrix("A"), state)
        rate = rate + times_column(self._matrix("B"), command.value)
        if not self.closed:
            return rate
        gap = output - times_column(self._matrix("C"), state)
        return rate + times_column(self._matrix("observer_gain"), gap)

    def sample(self, command: ReferenceSample, output: Tensor, state: Tensor) -> ReferenceSample:
        """y_m and its derivatives, the last of which the command enters."""
        C, rates = self._matrix("C"), self.rates(command, output, state)
        parts = [times_column(C, state), times_column(C, rates)]
        for _ in range(1, self.order):
            # No command, nor output, before the last derivative: C A^k B = 0, C A^k L = 0.
            C = C @ self._matrix("A")
            parts.append(times_column(C, rates))
        made = ReferenceSample(*parts)
        return made._replace(command=command.value, state=state)


def _relative_degree(A: Tensor, into: list[Tensor], C: Tensor) -> int:
    """How many derivatives of C x are there without one of what goes in, at most 4."""
    degree, row = 1, C.detach()
    while degree < MOST_DERIVATIVES and not any(bool((row @ x.detach()).any()) for x in into):
        degree, row = degree + 1, row @ A.detach()
    return degree


class SecondOrderModel(ReferenceModel):
    """y_m'' = w^2 (r - y_m) - 2 zeta w y_m': a smooth way to any command, a step too.

    Of each of p outputs alone; `frequency` w (p,) [rad/s] and `damping` zeta (p,) are constants. It
    starts at the plant's output, at rest. Raises `ConfigError`, `DomainError`, `ShapeError`,
    `KindError` or `DtypeError`.
    """

    order = 2

    def __init__(self, width: int, frequency: Numbers, damping: Numbers = 1.0) -> None:
        super().__init__()
        self.width = whole("width", width)
        self.frequency: Tensor
        self.damping: Tensor
        self.declare("frequency", frequency, PositiveRow(), (self.width,))
        self.declare("damping", damping, PositiveRow(), (self.width,))

    def initial_state(self, command: ReferenceSample, output: Tensor) -> Tensor:
        """(y, 0) (..., 2p)."""
        return torch.cat([output, torch.zeros_like(output)], dim=-1)

    def _acceleration(self, command: ReferenceSample, state: Tensor) -> Tensor:
        value, rate = state.split(self.width, dim=-1)
        w = self.frequency
        return w * (w * (command.value - value) - 2.0 * self.damping * rate)

    def rates(self, command: ReferenceSample, output: Tensor, state: Tensor) -> Tensor:
        """(y_m', y_m'') (..., 2p)."""
        rate = state[..., self.width :]
        return torch.cat([rate, self._acceleration(command, state)], dim=-1)

    def sample(self, command: ReferenceSample, output: Tensor, state: Tensor) -> ReferenceSample:
        """y_m and its two derivatives."""
        value, rate = state.split(self.width, dim=-1)
        acceleration = self._acceleration(command, state)
        return ReferenceSample(value, rate, acceleration, command=command.value, state=state)
