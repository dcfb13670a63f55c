"""A tick of flat tensors: what every runtime is given, and what it must give back."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor, nn

from ...checks import instance
from ...compiled import frozen, with_tensors
from ...errors import ExportError
from ..tick import REFUSED

if TYPE_CHECKING:
    from ..stepper import Stepper

#: Names of what goes in and out, in order.
INPUTS = ("state_f", "state_k", "reference", "measurement", "adapt")
OUTPUTS = ("input", "flags", "next_f", "next_k")
#: Of the largest number, where a runtime's are compared with the stepper's.
_CLOSE = {torch.float64: 1e-12, torch.float32: 1e-4}


class FlatTicked(NamedTuple):
    """What a flat tick gives."""

    input: Tensor  # (m,)
    flags: Tensor  # () int64
    next_f: Tensor  # (n_f,)
    next_k: Tensor  # (n_k,)


#: A tick as a runtime runs it, of the five that `INPUTS` names.
Running = Callable[[Tensor, Tensor, Tensor, Tensor, Tensor], FlatTicked]


class FlatTick(nn.Module):
    """A stepper's tick from flat tensors to flat tensors; its constants are buffers by name.

    The state is the stepper's, `stepper.blob.split(state)`: floating numbers (n_f,) and others
    (n_k,). `reference` (R,) and `measurement` (Y,) are rows, `adapt` () is bool.
    """

    def __init__(self, stepper: Stepper) -> None:
        super().__init__()
        values = stepper.values
        names = {name: name.replace(".", "__") for name in values}
        self._shapes = {name: tuple(x.shape) for name, x in values.items()}
        # In a tuple, so that its own tensors are not this module's too.
        self._parts = (frozen(stepper.tick), stepper.blob, names)
        for name, x in values.items():
            # AOTInductor can't compile two unsqueezes of a buffer without dimensions.
            self.register_buffer(names[name], x.clone().reshape(x.shape or (1,)))

    def forward(
        self,
        state_f: Tensor,
        state_k: Tensor,
        reference: Tensor,
        measurement: Tensor,
        adapt: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Command (m,), flags () and the next state (n_f,), (n_k,)."""
        tick, blob, names = self._parts
        held = {n: self.get_buffer(own).reshape(self._shapes[n]) for n, own in names.items()}
        with with_tensors(tick, held):
            made = tick(
                reference, measurement, adapt.to(state_f.dtype), blob.tree(state_f, state_k)
            )
        if made.input.dtype != state_f.dtype:
            raise ExportError(
                f"{type(tick.controller).__name__} computes in {made.input.dtype}: take that dtype"
            )
        return made.input.clone(), made.flags, *blob.flat(made.kept)


def checked(stepper: object) -> Stepper:
    """Raise `KindError` for what is no stepper."""
    from ..stepper import Stepper

    return instance("stepper", stepper, Stepper)


def example(stepper: Stepper) -> tuple[Tensor, ...]:
    """Inputs of a flat tick, of the right form."""
    f, k = stepper.blob.zeros()
    ports, dtype = stepper.ports, stepper.dtype
    rows = (torch.zeros(len(row), dtype=dtype) for row in (ports.reference, ports.measurement))
    return f, k, *rows, torch.ones((), dtype=torch.bool)


def told(stepper: Stepper) -> dict[str, str]:
    """What a file says of itself: names and units of its numbers, as JSON."""
    ports, blob = stepper.ports, stepper.blob
    said: dict[str, Any] = {
        "controller": type(stepper.tick.controller).__name__,
        "period_s": stepper.period,
        "dtype": str(stepper.dtype).removeprefix("torch."),
        "state_f": blob.n_f,
        "state_k": blob.n_k,
        "reference": ports.reference,
        "measurement": ports.measurement,
        "input": ports.input,
        "flags": {"refused": 1, "saturated": 2, "diverged": 4},
        "state": blob.mark.hex(),
    }
    return {f"mann_torch.{name}": json.dumps(value) for name, value in said.items()}


@torch.no_grad()
def check_agreement(stepper: Stepper, running: Running, runtime: str, ticks: int = 8) -> None:
    """Raise `ExportError` where some ticks of a runtime differ from the stepper's.

    Among them are one that does not adapt, and one refused. Each goes on from its own state: whole
    numbers may differ where rounding breaks a tie that nothing depends on.
    """
    draw, blob = torch.Generator().manual_seed(0), stepper.blob
    n, m = len(stepper.ports.reference), len(stepper.ports.measurement)

    def rows() -> tuple[Tensor, Tensor]:
        row = 0.1 * torch.randn(n + m, generator=draw).to(stepper.dtype)
        return row[:n], row[n:]

    state = stepper.initial_state(*rows(), torch.Generator().manual_seed(0))
    f, k = blob.split(state)
    for number in range(ticks):
        row, adapt = rows(), number != ticks - 2
        if number == ticks - 1:
            row[1][0] = torch.nan
        found = running(f, k, row[0], row[1], torch.tensor(adapt))
        wanted, state, flags = stepper.step(state, *row, adapt)
        numbers = torch.cat([blob.split(state)[0], wanted])
        off = (torch.cat([found.next_f, found.input]) - numbers).abs().max()
        same = int(found.flags) == flags
        if flags & REFUSED:
            same = same and torch.equal(found.next_f, f) and torch.equal(found.next_k, k)
        if not (same and off <= _CLOSE[stepper.dtype] * numbers.abs().max()):
            raise ExportError(
                f"{runtime} does not run {type(stepper.tick.controller).__name__} as the stepper "
                f"does: off by {float(off):.1e}, flags {int(found.flags)} where it has {flags}"
            )
        f, k = found.next_f, found.next_k
