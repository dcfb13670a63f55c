"""Steps recorded in Python, for C to take again."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ...trees import leaves
from ..stepper import Stepper

#: By how much numbers may differ, relative to the largest of their kind: a machine without fma
#: rounds otherwise. A record ends where rounding alone would come to a part of it.
TOLERANCE = {8: 1e-9, 4: 2e-3}
_PART = 0.03
#: Steps recorded at most and at least.
STEPS, _LEAST = 300, 10


class Record(NamedTuple):
    """What went in and what came out, a row a step."""

    references: list[Tensor]
    measurements: list[Tensor]
    inputs: list[Tensor]
    flags: list[int]
    #: Between these two nothing adapts; the state before the first.
    frozen: int
    free: int
    saved: bytes
    last: Tensor  # the state after the last step


def recorded(stepper: Stepper) -> Record:
    """Steps at sines: the reference with its derivatives, outputs measured that are near it.

    Beside them goes a copy whose state is shaken by its rounding at each step. Where it parts from
    the other, since a controller chatters or is unstable at such numbers, so may a machine that
    rounds otherwise: the record is shorter then.
    """
    steps = STEPS
    while True:
        record, parted = _run(stepper, steps)
        if parted is None or steps == _LEAST:
            return record
        steps = max(parted, _LEAST)


def _run(stepper: Stepper, steps: int) -> tuple[Record, int | None]:
    """A record, and the step from which rounding shows."""
    pairs = [_row(stepper, i * stepper.period) for i in range(steps)]
    frozen, free = 2 * steps // 5, 8 * steps // 15
    state = shaken = stepper.initial_state(*pairs[0])
    draw = torch.Generator().manual_seed(0)
    inputs, others, flags, saved = [], [], [], b""
    parted: int | None = None
    for i, pair in enumerate(pairs):
        saved = stepper.to_bytes(state) if i == frozen else saved
        adapt = not frozen <= i < free
        made = stepper.step(state, *pair, adapt=adapt)
        other = stepper.step(_shaken(stepper, shaken, draw), *pair, adapt=adapt)
        state, shaken = made.state, other.state
        inputs.append(made.input)
        others.append(other.input)
        flags.append(made.flags)
        alike = made.flags == other.flags and _decided(stepper, state, shaken)
        parted = i if parted is None and not alike else parted
    limit = _PART * TOLERANCE[stepper.dtype.itemsize]
    apart = (torch.stack(inputs) - torch.stack(others)).abs()
    largest = torch.stack(inputs).abs().amax(dim=0).clamp(min=1e-30)
    beyond = (~(apart <= limit * largest)).any(dim=-1).nonzero().flatten().tolist()
    found = [i for i in (parted, *beyond[:1]) if i is not None]
    if not found and not _close(stepper, state, shaken, limit):
        found = [2 * steps // 3]
    references, measurements = ([pair[k] for pair in pairs] for k in (0, 1))
    record = Record(references, measurements, inputs, flags, frozen, free, saved, state)
    return record, min(found, default=None)


def _shaken(stepper: Stepper, state: Tensor, draw: torch.Generator) -> Tensor:
    """A state whose numbers are off by a rounding or so.

    By one factor in a part: what is equal in it, as slots of a memory that nobody has written to,
    stays equal on any machine.
    """
    n, eps = stepper.blob.n_f, torch.finfo(state.dtype).eps
    kept = [x for x in leaves(stepper.unpacked(state)) if x.is_floating_point()]
    noise = torch.randn(len(kept), generator=draw, dtype=torch.float64).tolist()
    parts = [x.reshape(-1) * (1.0 + eps * z) for x, z in zip(kept, noise, strict=True)]
    return torch.cat([*parts, state[n:]])


def _decided(stepper: Stepper, a: Tensor, b: Tensor) -> bool:
    """Whether the decisions in two states are the same."""
    return a[stepper.blob.n_f : -1].numpy().tobytes() == b[stepper.blob.n_f : -1].numpy().tobytes()


def _close(stepper: Stepper, a: Tensor, b: Tensor, limit: float) -> bool:
    """Whether numbers of two states are, relative to the largest of each part."""
    n = stepper.blob.n_f
    sizes = scale(stepper, a).clamp(min=1e-30)
    return bool(((a[:n] - b[:n]).abs() <= limit * sizes).all())


def scale(stepper: Stepper, state: Tensor) -> Tensor:
    """The largest number of the part that each number of a state belongs to."""
    kept = [x for x in leaves(stepper.unpacked(state)) if x.is_floating_point()]
    return torch.cat(
        [x.abs().max().expand(x.numel()) if x.numel() else x.reshape(-1) for x in kept]
    )


def _row(stepper: Stepper, time: float) -> tuple[Tensor, Tensor]:
    ports, width = stepper.ports, stepper.ports.width
    reference = [
        0.8 * (1.0 + 0.3 * i) ** order
        * math.sin((1.0 + 0.3 * i) * time + 0.5 * i + 0.5 * math.pi * order)
        for order in range(ports.order + 1)
        for i in range(width)
    ]  # fmt: skip
    seen = [0.4 * math.sin((1.3 + 0.2 * i) * time + i) for i in range(len(ports.measurement))]
    for i, place in enumerate(ports.output or ()):
        seen[place] = reference[i] + 0.1 * math.sin(3.0 * time + i)
    row, other = (torch.tensor(x, dtype=torch.float64) for x in (reference, seen))
    return row.to(stepper.dtype), other.to(stepper.dtype)
