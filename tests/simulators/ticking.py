"""A controller that ticks: what a deployed one does, by the library's own rule for a tick."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.control.sampling import moved


class Ticking:
    """(state, reference, measurement) -> (u, state), of one robot."""

    def __init__(self, controller: mt.Controller, period: float, weights: Any = None) -> None:
        self.controller, self.period, self._weights = controller, period, weights

    def initial_state(self, reference: Any, measurement: Any) -> Any:
        own, mode = self.controller.initial_state(reference, measurement, (), weights=self._weights)
        return own, mode, None

    def __call__(self, state: Any, reference: Any, measurement: Any) -> tuple[Tensor, Any]:
        u, state, _ = self.step(state, reference, measurement)
        return u, state

    @torch.no_grad()
    def step(self, state: Any, reference: Any, measurement: Any) -> tuple[Tensor, Any, int]:
        own, mode, before = state
        if before is not None:
            elapsed = torch.tensor(self.period, dtype=torch.float64)
            own = moved(
                self.controller, elapsed, reference, measurement, own, mode,
                before.d_state, before.decay,
            )  # fmt: skip
        if mode is not None:
            own, mode = self.controller.jump(reference, measurement, own, mode)
        answer = self.controller(reference, measurement, own, mode)
        return answer.input, (own, mode, answer), 0
