"""A tick and a start as programs of the compiled engine: what runs here, and what C is made of."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from ..compiled import (
    Fingerprint,
    Program,
    Row,
    Rows,
    Single,
    UntraceableError,
    check_agreement,
    frozen,
    job_of,
    missing,
    program_of,
    with_tensors,
)
from ..constraints import held_tensors
from ..trees import leaves, rebuilt
from .tick import Kept, Tick


class TickStep:
    """A tick: (reference, measurement and adapt, kept) -> (kept, flags)."""

    def __init__(self, tick: Tick, names: Sequence[str], like: Kept) -> None:
        self._tick, self._names, self._like = frozen(tick), names, like

    def __call__(
        self,
        clock: Sequence[Tensor],
        constants: Sequence[Tensor],
        segments: Sequence[Tensor],
        noise: Sequence[Tensor],
        carry: Sequence[Tensor],
    ) -> list[Tensor]:
        """The next carry: what is kept, and flags."""
        with with_tensors(self._tick, dict(zip(self._names, constants, strict=True))):
            made = self._tick(*segments, rebuilt(self._like, carry[:-1]))
        return [*leaves(made.kept), made.flags]


class StartStep:
    """A start: (reference, measurement, anything kept) -> kept."""

    def __init__(self, tick: Tick, names: Sequence[str]) -> None:
        self._tick, self._names = frozen(tick), names

    def __call__(
        self,
        clock: Sequence[Tensor],
        constants: Sequence[Tensor],
        segments: Sequence[Tensor],
        noise: Sequence[Tensor],
        carry: Sequence[Tensor],
    ) -> list[Tensor]:
        """What is kept."""
        with with_tensors(self._tick, dict(zip(self._names, constants, strict=True))):
            return leaves(self._tick.start(segments[0], segments[1]))


def values_of(tick: Tick, dtype: torch.dtype) -> dict[str, Tensor]:
    """Copies of all tensors that a tick holds, by name, in the precision it runs in."""
    return {
        name: x.detach().to(dtype if x.is_floating_point() else x.dtype, copy=True)
        for name, x in held_tensors(tick).items()
    }


def step_program(tick: Tick, like: Kept, dtype: torch.dtype) -> tuple[Program, Rows]:
    """The tick's program. Raises `UntraceableError`."""
    values = values_of(tick, dtype)
    carry = [*leaves(like), torch.zeros((), dtype=torch.int64)]
    return _program(
        tick, "tick", values, [*_inputs(tick, dtype), torch.ones((), dtype=dtype)], carry,
        lambda: TickStep(tick, list(values), like),
    )  # fmt: skip


def start_program(tick: Tick, like: Kept) -> tuple[Program, Rows]:
    """The start's, in float64. Raises `UntraceableError`."""
    values = values_of(tick, torch.float64)
    return _program(
        tick, "start", values, _inputs(tick, torch.float64), leaves(like),
        lambda: StartStep(tick, list(values)),
    )  # fmt: skip


def _inputs(tick: Tick, dtype: torch.dtype) -> list[Tensor]:
    sizes = len(tick.ports.reference), len(tick.ports.measurement)
    return [torch.zeros(n, dtype=dtype) for n in sizes]


def _program(
    tick: Tick,
    kind: str,
    values: Mapping[str, Tensor],
    inputs: Sequence[Tensor],
    carry: Sequence[Tensor],
    step: Callable[[], Any],
) -> tuple[Program, Rows]:
    refusal = missing()
    if refusal is not None:
        raise UntraceableError(refusal)
    rows = Rows(
        [Row(x[None], False) for x in values.values()],
        [x[None, None] for x in inputs],
        [x[None] for x in carry],
    )
    prints = Fingerprint()
    key = (kind, Tick, prints.of(tick), tuple(tick.ports))
    return program_of(key, prints, step, rows), rows


class CompiledTick:
    """A tick on the compiled engine, from one flat tensor to the next.

    Raises `UntraceableError`, `KernelError`.
    """

    def __init__(self, tick: Tick, like: Kept, dtype: torch.dtype) -> None:
        with torch.no_grad():
            self.program, rows = step_program(tick, like, dtype)
            job, tensors = job_of(self.program, rows)
            check_agreement(self.program, job.lanes_used)
            self._single, self._lock = Single(job, *tensors), threading.Lock()
        sizes = [len(tick.ports.reference), len(tick.ports.measurement), 1]
        self._inputs = self._single.segments[0].split(sizes)

    def __call__(
        self, reference: Tensor, measurement: Tensor, adapt: bool, state: Tensor
    ) -> Tensor:
        """The flat tensor after a tick."""
        to_reference, to_measurement, to_adapt = self._inputs
        with self._lock:
            to_reference.copy_(reference)
            to_measurement.copy_(measurement)
            to_adapt.fill_(float(adapt))
            return self._single(state)
