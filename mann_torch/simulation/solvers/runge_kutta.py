"""The classical Runge-Kutta method, whole steps of which compile."""

from __future__ import annotations

from torch import Tensor

from .solver import Flow, Solver


class RungeKutta(Solver):
    """Kutta's method of order 4, for loops that are not stiff.

    Explicit: stable up to h |lambda| = 2.8. `compile` serves the torch engine alone. Raises as
    `Solver`.
    """

    def __init__(self, dt: float = 1e-3, compile: bool = False) -> None:
        super().__init__(dt, compile)

    @property
    def name(self) -> str:
        """runge_kutta"""
        return "runge_kutta"

    def step(self, flow: Flow, t: Tensor, h: Tensor, y: Tensor) -> Tensor:
        """One step (..., M) -> (..., M); t and h are () or, a sample at its own, (...,) [s]."""
        middle, wide = t + 0.5 * h, h.unsqueeze(-1)
        k_1 = flow(t, y)
        k_2 = flow(middle, y + 0.5 * wide * k_1)
        k_3 = flow(middle, y + 0.5 * wide * k_2)
        k_4 = flow(t + h, y + wide * k_3)
        return y + wide * ((k_1 + k_4) + 2.0 * (k_2 + k_3)) / 6.0
