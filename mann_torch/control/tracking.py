"""Tracking error and filtered tracking error."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..checks import whole, wrong
from ..constraints import DesignModule, SymmetricPositiveDefinite
from ..errors import ShapeError
from ..functional import Numbers, times_column
from ..types import InputGains, Measurement, ReferenceSample, TrackingError


def check_measured(measurement: Any, otherwise: str = "") -> None:
    """Raise `KindError` unless positions `q` and velocities `qd` are measured.

    `otherwise` is what else a controller may be given.
    """
    if not (hasattr(measurement, "q") and hasattr(measurement, "qd")):
        wanted = "of positions q and velocities qd, for this controller"
        raise wrong("measurement", measurement, wanted + otherwise)


def check_joints(n_joints: int, n_inputs: int, n_outputs: int) -> None:
    """Raise `ShapeError` unless a plant has an input for each of `n_joints` outputs."""
    if (n_inputs, n_outputs) != (n_joints, n_joints):
        raise ShapeError(
            f"a plant of {n_inputs} inputs and {n_outputs} outputs got a controller of {n_joints}"
        )


def tracking_gains(position: Tensor, rate: Tensor, reference: ReferenceSample) -> InputGains:
    """Of an input that answers to e and de/dt by gains (..., m, n).

    As time goes on, the reference moves both.
    """
    drift = times_column(position, reference.upto(1)[1])
    if reference.acceleration is not None:
        drift = drift + times_column(rate, reference.acceleration)
    return InputGains(torch.cat([position, rate], dim=-1), drift)


class FilteredTracking(DesignModule):
    """e = s - x, r = de/dt + Lambda e.

    `error_gain` is Lambda [1/s]: a scalar, n diagonal entries, or an SPD matrix (..., n, n).
    """

    def __init__(self, n_joints: int, error_gain: Numbers = 5.0) -> None:
        super().__init__()
        n_joints = whole("n_joints", n_joints)
        self.error_gain: Tensor
        self.declare("error_gain", error_gain, SymmetricPositiveDefinite(), (n_joints, n_joints))

    def forward(self, reference: ReferenceSample, measurement: Measurement) -> TrackingError:
        """Errors (..., n) of a measurement against the reference."""
        s, ds = reference.upto(1)
        error = s - measurement.q
        error_rate = ds - measurement.qd
        filtered = error_rate + times_column(self.error_gain, error)
        return TrackingError(error, error_rate, filtered)
