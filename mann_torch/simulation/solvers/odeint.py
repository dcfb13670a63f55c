"""torchdiffeq's methods behind the solver interface. The only file that imports torchdiffeq.

It brings scipy along, so that it is imported when a step is first taken.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from ...checks import POSITIVE, choice, number, whole
from ...errors import ConfigError, SolverError
from .solver import Flow, Solver

ADAPTIVE = ("dopri5", "dopri8", "bosh3", "fehlberg2", "adaptive_heun")
FIXED = ("rk4", "euler", "midpoint", "heun2", "heun3", "explicit_adams", "implicit_adams")
METHODS = (*ADAPTIVE, *FIXED, "scipy_solver")

# Stands for a non-finite derivative: adaptive methods shrink their step, fixed ones diverge.
HUGE = 1e30


class Odeint(Solver):
    """A torchdiffeq method from decision time to decision time, `dt` [s] apart.

    `method` is one of `METHODS`; `rtol`, `atol` serve the adaptive ones and hold per sample (the
    step is shared over the batch); `max_step` [s] is the inner step of the fixed ones, `dt` if not
    given. `scipy_solver` (LSODA) gives no gradient. A step that torchdiffeq refuses, or that needs
    more than `max_evaluations`, is repeated sample by sample: only those that fail come back NaN.

    Raises `ConfigError` for an unknown method or a setting out of range, `KindError`.
    """

    fuses_step = False

    def __init__(
        self,
        method: str = "dopri5",
        dt: float = 5e-3,
        rtol: float = 1e-5,
        atol: float = 1e-8,
        max_step: float | None = None,
        max_evaluations: int = 10_000,
        compile: bool = False,
    ) -> None:
        super().__init__(dt, compile)
        self.method = choice("method", method, METHODS)
        self.rtol, self.atol = number("rtol", rtol, POSITIVE), number("atol", atol, POSITIVE)
        self.max_step = self.dt if max_step is None else number("max_step", max_step, POSITIVE)
        self.max_evaluations = whole("max_evaluations", max_evaluations)
        # torchdiffeq lays out all inner steps before the first evaluation: memory, not time, ends.
        if self.dt > self.max_evaluations * self.max_step:
            raise ConfigError(
                f"max_step = {max_step}: dt = {dt} takes over {max_evaluations} inner steps "
                "(max_evaluations)"
            )

    @property
    def name(self) -> str:
        """The method's name."""
        return self.method

    def step(self, flow: Flow, t: Tensor, h: Tensor, y: Tensor) -> Tensor:
        """y(t + h); samples that fail are NaN."""
        shape = y.shape
        everyone = torch.ones(shape[:-1], dtype=torch.bool)
        try:
            return self._solve(flow, t, h, y, everyone)
        except (SolverError, AssertionError):
            if everyone.numel() == 1:
                return torch.full_like(y, torch.nan)
        rows = []
        for index in range(everyone.numel()):
            alone = torch.zeros(everyone.numel(), dtype=torch.bool)
            alone[index] = True
            try:
                solved = self._solve(flow, t, h, y, alone.reshape(everyone.shape))
                rows.append(solved.reshape(-1, shape[-1])[index])
            except (SolverError, AssertionError):
                rows.append(torch.full_like(y.reshape(-1, shape[-1])[index], torch.nan))
        return torch.stack(rows).reshape(shape)

    def _solve(self, flow: Flow, t: Tensor, h: Tensor, y: Tensor, moving: Tensor) -> Tensor:
        from torchdiffeq import odeint

        evaluations = 0

        def rate(time: Tensor, state: Tensor) -> Tensor:
            nonlocal evaluations
            evaluations += 1
            if evaluations > self.max_evaluations:
                raise SolverError(
                    f"{self.method} needed over {self.max_evaluations} evaluations at "
                    f"t = {float(time):.6g} s: take a smaller dt or solver=implicit"
                )
            value = torch.where(moving.unsqueeze(-1), flow(time, state), 0.0)
            return torch.nan_to_num(value, nan=HUGE, posinf=HUGE, neginf=-HUGE)

        times = torch.stack([t, t + h])
        end: Tensor = odeint(rate, y, times, method=self.method, **self._settings(times))[-1]
        return end

    def _settings(self, times: Tensor) -> dict[str, Any]:
        if self.method in ADAPTIVE:
            # step_t: end on t + h itself; it would step beyond and interpolate at lower order.
            options = {"norm": _worst_sample, "step_t": times[1:]}
            return {"rtol": self.rtol, "atol": self.atol, "options": options}
        if self.method == "scipy_solver":
            return {"rtol": self.rtol, "atol": self.atol, "options": {"solver": "LSODA"}}
        h = float(times[1] - times[0])
        pieces = max(1, math.ceil(h / self.max_step - 1e-6))
        return {"options": {"step_size": h / pieces}}


def _worst_sample(error: Tensor) -> Tensor:
    """Largest RMS over the samples: no sample hides behind its batch mates."""
    return error.square().mean(dim=-1).sqrt().max()
