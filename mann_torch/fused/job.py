"""What a fused rollout is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from torch import Tensor

from .form import Form


class Inputs(NamedTuple):
    """What gradients reach: float64, one row a sample of the flat batch B."""

    amplitude: Tensor  # (B, n)
    frequency: Tensor  # (B, n)
    reference_offset: Tensor  # (B, n)
    error_gain: Tensor  # (B, n, n)
    constant: Tensor  # (B, 9), order of `form.CONSTANTS`
    coefficient: Tensor  # (segments, B, 10)
    q: Tensor  # (B, n), the state at t = 0 from here on
    qd: Tensor  # (B, n)
    W: Tensor  # (B, N, n)
    b_w: Tensor  # (B, n)
    V: Tensor  # (B, I, N)
    b_v: Tensor  # (B, N)
    mu: Tensor | None  # (B, S, N)
    keys: Tensor | None  # (B, S, n)
    squared: Tensor  # (B, n), squared error at t = 0 times its share of time
    torque: Tensor | None  # (B, n), of the step before; None where effort is not measured
    effort: Tensor | None  # (B, 2n), integral of squared torque rates, and peak torques


PARAMETERS = Inputs._fields[:6]
LEAVES = Inputs._fields[6:14]
CARRIED = Inputs._fields[6:]
#: What a row of the kept motion holds, one after the other.
MOTION = ("q", "qd", "squared", "effort")
#: Those kept as outputs with a gradient.
KEPT = LEAVES


class Grid(NamedTuple):
    """The time grid; a slot of -1 marks a time that is not kept."""

    times: Tensor  # (T+1,) [s]
    segment: Tensor  # (T,) int32, row of `coefficient` in force
    motion_slot: Tensor  # (T+1,) int32, row of the kept motion
    state_slot: Tensor  # (T+1,) int32, row of the kept states
    share: Tensor  # (T+1,), time that each squared error stands for [s]
    noise_index: Tensor | None  # (T,) int32, sampling instant of each step

    @property
    def n_steps(self) -> int:
        """T."""
        return len(self.times) - 1


@dataclass(frozen=True)
class Job:
    """One rollout, apart from what gradients reach."""

    form: Form
    gamma: float
    grid: Grid
    horizon: Tensor  # (B,) [s]
    active: Tensor | None  # (B, S) float64, 1 for slots in use at t = 0
    counts: Tensor | None  # (B, 3) int32: attended, switches, reallocations; hybrid: (B, 6)
    noise_std: Tensor | None  # (B, 2) [rad], [rad/s]
    noise_row: Tensor | None  # (B,) int32, row of `noise_unit`
    noise_unit: Tensor | None  # (R, K, 2n)
    effort_after: float  # time after which peak torques count [s]
    limit: float
    device: str
    tape_memory: float  # [bytes]
    progress: Callable[[int], object] | None


#: Members of a job that the kernel takes under their own names.
AS_THEY_ARE = ("limit", "effort_after", "noise_std", "noise_row", "noise_unit", "horizon")
