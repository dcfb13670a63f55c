"""The solver interface: one step of a flat state."""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol

from torch import Tensor

from ...checks import POSITIVE, flag, number
from ...interface import Interface
from ..lagged import AnyBlock


class Flow(Protocol):
    """The vector field of a loop on flat states y (..., M), which begin with the plant's."""

    def __call__(self, t: Tensor, y: Tensor) -> Tensor:
        """dy/dt (..., M)."""

    def linearized(self, t: Tensor, y: Tensor) -> tuple[Tensor, AnyBlock | None]:
        """dy/dt (..., M) and the stiff block of the plant's state, None where nothing is stiff."""


class Solver(Interface):
    """Interface of every solver. `dt` [s] is the step, and the interval of decisions.

    With `compile`, the rollout runs what `fuses_step` says through `torch.compile`.
    Raises `ConfigError` unless dt is finite and > 0, `KindError` for an argument of a wrong type.
    """

    #: True if the whole step can be compiled, False if only the vector field can.
    fuses_step = True

    def __init__(self, dt: float, compile: bool = False) -> None:
        self.dt = number("dt", dt, POSITIVE)
        self.compile = flag("compile", compile)

    @property
    @abstractmethod
    def name(self) -> str:
        """The name a configuration uses."""

    @abstractmethod
    def step(self, flow: Flow, t: Tensor, h: Tensor, y: Tensor) -> Tensor:
        """y(t + h) (..., M) from y(t); a sample that cannot be integrated comes back as NaN."""
