"""What the ticks of the benchmark are taken of: a simulated arm's motion at 1 kHz, recorded."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.trees import map_tensors

from ..building.build import build
from ..building.ensembles import composed

TICKS, PERIOD = 100_000, 1e-3


class Recorded(NamedTuple):
    """A controller, and what it saw and followed in simulation."""

    loop: mt.ClosedLoop
    reference: Tensor  # (TICKS, R)
    measurement: Tensor  # (TICKS, Y)
    weights: object  # that it started from

    def stepper(self, dtype: torch.dtype, engine: str = "compiled") -> mt.Stepper:
        """The controller alone."""
        return mt.deploy(self.loop, dtype=dtype, engine=engine)

    def start(self, stepper: mt.Stepper) -> Tensor:
        """The state before the first tick."""
        reference, measurement = (
            x[0].to(stepper.dtype) for x in (self.reference, self.measurement)
        )
        return stepper.initial_state(reference, measurement, weights=self.weights)


def recorded(controller: str, ticks: int = TICKS) -> Recorded:
    """The paper's first scenario under a controller that samples every millisecond."""
    made = build(
        composed(
            (
                *("scenario='1'", f"controller={controller}", "draws=1", "clock=periodic"),
                *(f"clock.period={PERIOD}", f"horizon={ticks * PERIOD}"),
            )
        )
    )
    with torch.no_grad():
        run = mt.rollout(
            made.loop,
            made.scenario,
            mt.Implicit(PERIOD),
            weights=made.weights,
            motion_dt=PERIOD,
            sample_until=0.0,
        )
    sample, (q, qd) = run.reference.upto(2), run.plant
    parts = [x.expand_as(q) for x in sample], [q, qd]
    reference, measurement = (torch.cat(row, dim=-1)[:ticks, 0] for row in parts)
    return Recorded(made.loop, reference, measurement, map_tensors(lambda x: x[0], made.weights))
