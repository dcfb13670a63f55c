"""Whether a compiled step does what eager torch does: asked once, before it is used."""

from __future__ import annotations

import torch
from torch import Tensor

from .autograd import march
from .engine import Job
from .program import Program
from .tracing import Untraceable

#: Largest difference, relative to the largest entry of a value, that rounding explains.
TOLERANCE = 1e-10


def check_agreement(program: Program) -> None:
    """Raise `Untraceable` unless one step of the compiled form gives what the function gives.

    A number drawn in Python, or one that a module counts up, is baked into a trace: here it shows.
    """
    with torch.no_grad():
        expected = program.flat_step(program.examples)
    found = one_step(program)
    for i, (mine, other) in enumerate(zip(found, expected, strict=True)):
        _compare(f"carried value {i}", mine, other)


def one_step(program: Program) -> list[Tensor]:
    """The carry after one compiled step from the examples."""
    job, constants, segments, carry = one_step_job(program)
    with torch.no_grad():
        marched = march(job, constants, segments, carry)
    found, layout = [], program.layout
    for leaf, (array, offset) in zip(layout.carry, layout.carry_places, strict=True):
        row = (marched.last_f if array == "f" else marched.last_k)[0]
        value = row[offset : offset + torch.Size(leaf.shape).numel()].reshape(leaf.shape)
        found.append(value != 0 if leaf.kind == "b" else value)
    return found


def one_step_job(program: Program) -> tuple[Job, Tensor, Tensor, Tensor]:
    """A march of one step of one sample, from the program's examples."""
    given = program.arguments(program.examples)
    constants = [given.constants[i] for i in program.used]
    slot = torch.tensor([-1, 0], dtype=torch.int32)
    noise = None
    if given.noise:
        table = torch.cat([x.reshape(1, 1, -1) for x in given.noise], dim=-1)
        zero = torch.zeros(1, dtype=torch.int32)
        noise = (table, zero, zero)
    job = Job(
        program=program,
        clock=torch.stack(given.clock).unsqueeze(0) if given.clock else torch.zeros(1, 0),
        segment_of=torch.zeros(1, dtype=torch.int32),
        noise=noise,
        whole=row_of(constants, False),
        carry_k=row_of(given.carry, False),
        motion_slot=slot,
        state_slot=slot,
        limit=float("inf"),
        tape_memory=1e9,
        wanted=((), ()),
    )
    return job, row_of(constants, True), row_of(given.segments, True)[None], row_of(given.carry, True)


def row_of(tensors: list[Tensor], floating: bool) -> Tensor:
    """The floating tensors, or the others as int64, side by side: (1, M)."""
    chosen = [t for t in tensors if t.is_floating_point() == floating]
    parts = [(-t.long() if t.dtype == torch.bool else t).reshape(1, -1) for t in chosen]
    if parts:
        return torch.cat(parts, dim=-1).to(torch.float64 if floating else torch.int64)
    return torch.zeros(1, 0, dtype=torch.float64 if floating else torch.int64)


def _compare(what: str, mine: Tensor, other: Tensor) -> None:
    if mine.dtype != other.dtype or not other.is_floating_point():
        if not torch.equal(mine.to(other.dtype), other):
            raise Untraceable(f"{what} differs between the compiled step and eager torch")
        return
    same = (mine == other) | (mine.isnan() & other.isnan())
    scale = other[other.isfinite()].abs().amax() if bool(other.isfinite().any()) else 1.0
    close = (mine - other).abs() <= TOLERANCE * scale
    if not bool((same | close).all()):
        worst = float(torch.where(same, 0.0, (mine - other).abs()).max())
        raise Untraceable(
            f"{what} of the compiled step differs from eager torch by {worst:.1e}: it may depend on "
            "a number that Python draws or counts"
        )
