"""A tick and a start as programs of the compiled engine: what runs here, and what C is made of."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence

import torch
from torch import Tensor

from ..compiled import (
    Arguments,
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

#: (tick, inputs, what is kept and flags) -> the same after it.
Run = Callable[[Tick, Sequence[Tensor], Sequence[Tensor]], list[Tensor]]


class TickStep:
    """What a tick does, as a step of one sample: (inputs, kept) -> carry, by `run` of the tick."""

    def __init__(self, tick: Tick, names: Sequence[str], run: Run) -> None:
        self._tick, self._names, self._run = frozen(tick), names, run

    def __call__(self, given: Arguments) -> list[Tensor]:
        """The next carry."""
        with with_tensors(self._tick, dict(zip(self._names, given.constants, strict=True))):
            return self._run(self._tick, given.segments, given.carry)


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
    inputs = [*_inputs(tick, dtype), torch.ones((), dtype=dtype)]

    def run(tick: Tick, inputs: Sequence[Tensor], carry: Sequence[Tensor]) -> list[Tensor]:
        made = tick(*inputs, rebuilt(like, carry[:-1]))
        return [*leaves(made.kept), made.flags]

    return _program(tick, "tick", values, inputs, carry, run)


def start_program(tick: Tick, like: Kept) -> tuple[Program, Rows]:
    """The start's, in float64. Raises `UntraceableError`."""
    values = values_of(tick, torch.float64)

    def run(tick: Tick, inputs: Sequence[Tensor], carry: Sequence[Tensor]) -> list[Tensor]:
        return leaves(tick.start(inputs[0], inputs[1]))

    return _program(tick, "start", values, _inputs(tick, torch.float64), leaves(like), run)


def _inputs(tick: Tick, dtype: torch.dtype) -> list[Tensor]:
    sizes = len(tick.ports.reference), len(tick.ports.measurement)
    return [torch.zeros(n, dtype=dtype) for n in sizes]


def _program(
    tick: Tick,
    kind: str,
    values: Mapping[str, Tensor],
    inputs: Sequence[Tensor],
    carry: Sequence[Tensor],
    run: Run,
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
    return program_of(key, prints, lambda: TickStep(tick, list(values), run), rows), rows


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
