"""The classical Runge-Kutta method, whole steps of which compile."""

from __future__ import annotations

from torch import Tensor

from ...checks import whole
from .solver import Flow, Solver


class RungeKutta(Solver):
    """Kutta's method of order 4, `substeps` of it a step: for loops that are not stiff.

    Explicit: stable up to h |lambda| = 2.8. Decisions fall on steps of `dt`, not on substeps.
    `compile` serves the torch engine alone. Raises as `Solver`, and for substeps below 1.
    """

    def __init__(self, dt: float = 1e-3, compile: bool = False, substeps: int = 1) -> None:
        super().__init__(dt, compile)
        self.substeps = whole("substeps", substeps)

    @property
    def name(self) -> str:
        """runge_kutta"""
        return "runge_kutta"

    def step(self, flow: Flow, t: Tensor, h: Tensor, y: Tensor) -> Tensor:
        """One step (..., M) -> (..., M); t and h are () or, a sample at its own, (...,) [s]."""
        part = h / self.substeps
        wide = part.unsqueeze(-1)
        for k in range(self.substeps):
            begin = t + k * part if k else t
            middle, end = begin + 0.5 * part, begin + part
            k_1 = flow(begin, y)
            k_2 = flow(middle, y + 0.5 * wide * k_1)
            k_3 = flow(middle, y + 0.5 * wide * k_2)
            k_4 = flow(end, y + wide * k_3)
            y = y + wide * ((k_1 + k_4) + 2.0 * (k_2 + k_3)) / 6.0
        return y
