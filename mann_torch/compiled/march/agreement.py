"""Whether a compiled step does what eager torch does: asked once, before it is used."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from ..trace.telling import UntraceableError
from .autograd import march
from .engine import Job
from .program import Program

#: Largest difference, relative to the largest entry of a value, that rounding explains.
TOLERANCE = {torch.float64: 1e-10, torch.float32: 1e-5}
#: The same against the largest of all values, where one has all but cancelled.
CANCELLED = {torch.float64: 1e-4, torch.float32: 0.1}
#: How much smaller carried numbers are where gradients are compared.
SMALLER = 1e-3
#: Numbers of the constants and of the segments with gradients; None: forward alone.
Wanted = tuple[tuple[int, ...], tuple[int, ...]] | None


def check_agreement(program: Program, lanes: int, wanted: Wanted = None) -> None:
    """Raise `UntraceableError` unless one step of the compiled form gives what the function gives.

    With `wanted` (numbers of constants and of segments), one vector-Jacobian product too. A number
    drawn in Python, or one that a module counts up, is baked into a trace: here it shows.
    """
    for key in ((lanes, None), (lanes, wanted)):
        if key not in program.verdicts:
            try:
                (_check_step if key[1] is None else _check_gradient)(program, *key)
            except UntraceableError as error:
                program.verdicts[key] = str(error)
                raise
            program.verdicts[key] = None
        refusal = program.verdicts[key]
        if refusal is not None:
            raise UntraceableError(refusal)


def _check_step(program: Program, lanes: int, _: Wanted) -> None:
    """At the examples; whole numbers that differ there, off the kinks: rounding decides ties."""
    try:
        _check_step_at(program, lanes, program.examples, whole=True)
    except UntraceableError:
        _check_step_at(program, lanes, program.examples, whole=False)
        _check_step_at(program, lanes, _off_kinks(program), whole=True)


def _check_step_at(program: Program, lanes: int, examples: list[Tensor], whole: bool) -> None:
    with torch.no_grad():
        expected = program.flat_step(examples)
        marched = march(*one_step_job(program, lanes, None, examples))
    layout, found = program.layout, []
    shown = [i for i in range(len(layout.carry)) if i not in program.private]
    shown = [i for i in shown if whole or layout.carry[i].kind == "f"]
    for i in shown:
        leaf, (array, offset) = layout.carry[i], layout.carry_places[i]
        row = (marched.last_f if array == "f" else marched.last_k)[0]
        value = row[offset : offset + torch.Size(leaf.shape).numel()].reshape(leaf.shape)
        found.append(value != 0 if leaf.kind == "b" else value)
    _compare_all("carried value", found, [expected[i] for i in shown])


def _off_kinks(program: Program) -> list[Tensor]:
    """The examples with what is carried a little smaller, each number by a share of its own.

    Where a rollout begins numbers are often equal that later are not (slots that hold the same):
    there a derivative is a matter of rounding, and nothing can be compared.
    """
    first, generator = program.given.first_carry, torch.Generator().manual_seed(1)
    moved = [*program.examples]
    for i in range(first, len(moved)):
        x = moved[i]
        if x.is_floating_point():
            shares = torch.rand(x.shape, generator=generator, dtype=x.dtype)
            moved[i] = x * (1.0 - SMALLER * shares)
    return moved


def _check_gradient(program: Program, lanes: int, wanted: Wanted) -> None:
    """Against `torch.func.vjp` of the function itself, for one random vector."""
    constants, segments = wanted or ((), ())
    examples = _off_kinks(program)
    places = program.scope.wanted_places(constants, segments)
    floating = program.layout.floating

    def moved(*values: Tensor) -> tuple[Tensor, ...]:
        full = [*examples]
        for place, value in zip(places, values, strict=True):
            full[place] = value
        results = program.flat_step(full)
        return tuple(results[i] for i in floating)

    with torch.inference_mode(False), torch.enable_grad():
        pulled = torch.func.vjp(moved, *(examples[i] for i in places))
        results, pull = pulled[0], pulled[1]
        generator = torch.Generator().manual_seed(0)
        given = tuple(torch.randn(r.shape, generator=generator, dtype=r.dtype) for r in results)
        expected = pull(given)
        job, *tensors = one_step_job(program, lanes, wanted, examples)
        free = [t.clone().requires_grad_(True) for t in tensors]
        marched = march(job, *free)
        row = torch.cat([g.reshape(-1) for g in given])
        slopes = torch.autograd.grad(marched.state_f, free, row.reshape(marched.state_f.shape))
    layout = program.layout
    found = []
    for i in constants:
        place, offset = layout.constant_places[i]
        row = slopes[3] if place == "shared" else slopes[0][0]
        found.append(row[offset : offset + math.prod(layout.constants[i].shape)])
    found += [slopes[1][0, 0, program.scope.segment_columns(segments)], slopes[2][0]]
    parts = torch.cat(found).split([e.numel() for e in expected])
    mine = [part.reshape(e.shape) for part, e in zip(parts, expected, strict=True)]
    _compare_all("gradient", mine, expected)


def one_step_job(
    program: Program,
    lanes: int | None = None,
    wanted: Wanted = None,
    examples: Sequence[Tensor] | None = None,
) -> tuple[Job, Tensor, Tensor, Tensor, Tensor]:
    """A march of one step of one sample, from the program's examples or others."""
    layout, real = program.layout, program.layout.real
    given = program.scope.arguments(program.examples if examples is None else examples)
    constants = [given.constants[i] for i in program.used]
    slot = torch.tensor([-1, 0], dtype=torch.int32)
    noise = None
    if given.noise:
        table = torch.cat([x.reshape(1, 1, -1) for x in given.noise], dim=-1)
        zero = torch.zeros(1, dtype=torch.int32)
        noise = (table, zero, zero)
    job = Job(
        program=program,
        clock=row_of(given.clock, True, real.dtype),
        segment_of=torch.zeros(1, dtype=torch.int32),
        noise=noise,
        whole=row_of(constants, False),
        carry_k=row_of(given.carry, False),
        motion_slot=slot,
        state_slot=slot,
        limit=float("inf"),
        tape_memory=1e9,
        wanted=wanted or ((), ()),
        lanes=lanes,
    )
    floating: dict[str, list[Tensor]] = {"constant": [], "shared": [], "whole": []}
    for leaf, tensor in zip(layout.constants, constants, strict=True):
        floating[leaf.place].append(tensor)
    rows = (floating["constant"], given.segments, given.carry, floating["shared"])
    own, segments, carry, shared = (row_of(row, True, real.dtype) for row in rows)
    return job, own, segments[None], carry, shared[0]


def row_of(tensors: list[Tensor], floating: bool, dtype: torch.dtype = torch.float64) -> Tensor:
    """The floating tensors, or the others as int64, side by side: (1, M)."""
    chosen = [t for t in tensors if t.is_floating_point() == floating]
    parts = [(-t.long() if t.dtype == torch.bool else t).reshape(1, -1) for t in chosen]
    if parts:
        return torch.cat(parts, dim=-1).to(dtype if floating else torch.int64)
    return torch.zeros(1, 0, dtype=dtype if floating else torch.int64)


def _compare_all(what: str, mine: list[Tensor], others: Sequence[Tensor]) -> None:
    """Each value against its own largest entry, or a small part of the largest of all.

    What is left of numbers that cancel is rounding, and no more than that.
    """
    sizes = [_largest(other) for other in others]
    dtype = next((x.dtype for x in others if x.is_floating_point()), torch.float64)
    least = CANCELLED[dtype] * max(sizes, default=0.0)
    for i, (own, other, size) in enumerate(zip(mine, others, sizes, strict=True)):
        _compare(f"{what} {i}", own, other, max(size, least))


def _largest(x: Tensor) -> float:
    """Largest finite entry of a floating value; 0 for others."""
    if not x.is_floating_point() or not bool(x.isfinite().any()):
        return 0.0
    return float(x[x.isfinite()].abs().max())


def _compare(what: str, mine: Tensor, other: Tensor, scale: float) -> None:
    if not other.is_floating_point():
        if not torch.equal(mine.to(other.dtype), other):
            raise UntraceableError(f"{what} differs between the compiled step and eager torch")
        return
    same = (mine == other) | (mine.isnan() & other.isnan())
    close = (mine - other).abs() <= TOLERANCE[other.dtype] * scale
    if not bool((same | close).all()):
        worst = float(torch.where(same, 0.0, (mine - other).abs()).max())
        raise UntraceableError(
            f"{what} of the compiled step differs from eager torch by {worst:.1e} of {scale:.1e}: "
            "it may depend on a number that Python draws or counts"
        )
