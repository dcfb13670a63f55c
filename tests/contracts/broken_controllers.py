"""Controllers that break a line of their contract, and what is told of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from mann_torch import control
from mann_torch.constraints import FiniteRow, Positive
from mann_torch.errors import ShapeError
from mann_torch.types import ControlOutput, InputGains, MemoryMode, Proximity


class Memory(NamedTuple):
    integral: Tensor  # (..., 1)


class Seen(NamedTuple):
    error: Tensor  # (..., 1)


class Good(control.Controller):
    """u = kp e + kd e' + ki I of a mass on a line, I' = e: what the others break."""

    reference_order = 1

    def __init__(self) -> None:
        super().__init__()
        self.gain: Tensor
        self.rows: Tensor
        self.declare("gain", 3.0, Positive())
        self.declare("rows", [2.0], FiniteRow(), (1,))

    def check_fit(self, n_inputs, n_outputs):
        if (n_inputs, n_outputs) != (1, 1):
            raise ShapeError("one input and one output")

    def initial_state(self, reference, measurement, batch_shape, generator=None, weights=None):
        return Memory(torch.zeros(*batch_shape, 1, dtype=torch.float64)), None

    def forward(self, reference, measurement, state, mode):
        value, rate = reference.upto(1)
        e, de = value - measurement.q, rate - measurement.qd
        u = self.gain.unsqueeze(-1) * (e + 0.1 * state.integral) + self.rows * de
        return ControlOutput(u, Memory(e), Seen(e))


def changed(base: type = Good, **members: Any) -> control.Controller:
    return type("Broken", (base,), members)()


def other_input(compute: Callable[..., Tensor]) -> control.Controller:
    """The mass's with another input, of (self, e, de, I)."""

    def forward(self, reference, measurement, state, mode):
        right = Good.forward(self, reference, measurement, state, mode)
        e = right.signals.error
        return right._replace(input=compute(self, e, reference.rate - measurement.qd, *state))

    return changed(forward=forward)


def other_answer(**parts: Callable[[ControlOutput], Any]) -> control.Controller:
    """The mass's with another member of its answer."""

    def forward(self, reference, measurement, state, mode):
        right = Good.forward(self, reference, measurement, state, mode)
        return right._replace(**{name: make(right) for name, make in parts.items()})

    return changed(forward=forward)


def starting(make: Callable[..., Any]) -> control.Controller:
    """The mass's with another start, of (batch_shape, generator)."""

    def initial_state(self, reference, measurement, batch_shape, generator=None, weights=None):
        return make(tuple(batch_shape), generator)

    return changed(initial_state=initial_state)


def zeros(*shape: int) -> Tensor:
    return torch.zeros(*shape, dtype=torch.float64)


def counted(self: Any, e: Tensor, de: Tensor, integral: Tensor) -> Tensor:
    self.calls = getattr(self, "calls", 0) + 1
    return e + 1e-6 * self.calls


def written(self: Any, e: Tensor, de: Tensor, integral: Tensor) -> Tensor:
    integral.add_(1.0)
    return e


def decided(self: Any, e: Tensor, de: Tensor, integral: Tensor) -> Tensor:
    return 2.0 * e if bool((e > 100.0).any()) else e


def picky(self: Any, e: Tensor, de: Tensor, integral: Tensor) -> Tensor:
    if e.shape == (2, 1):
        raise RuntimeError("not of two")
    return e


def of_two(self: Any, e: Tensor, de: Tensor, integral: Tensor) -> Tensor:
    """What the compiled engine, which traces one sample, sees otherwise."""
    return 2.0 * e if e.shape == (2, 1) else e


def undeclared() -> control.Controller:
    broken = Good()
    broken.ratio = torch.ones((), dtype=torch.float64)
    return broken


def of_float32() -> control.Controller:
    broken = Good()
    broken.register_buffer("ratio", torch.ones(()))
    return broken


class Counting(Good):
    """A mode that counts on."""

    def initial_state(self, reference, measurement, batch_shape, generator=None, weights=None):
        state, _ = super().initial_state(reference, measurement, batch_shape)
        return state, Memory(zeros(*batch_shape, 1))

    def jump(self, reference, measurement, state, mode):
        return state, Memory(mode.integral + 1.0)


class Resetting(Good):
    """A state that is reset, without a word of it."""

    def jump(self, reference, measurement, state, mode):
        return Memory(torch.zeros_like(state.integral)), mode


class Switching(Good):
    """A mode of slots; its reset does not look at what is due."""

    reallocates = True
    switches = True
    width = 1

    def initial_state(self, reference, measurement, batch_shape, generator=None, weights=None):
        count = torch.zeros(batch_shape, dtype=torch.int64)
        active = torch.ones(*batch_shape, 2, dtype=torch.bool)
        mode = MemoryMode(active, count, count, count)
        return Good.initial_state(self, reference, measurement, batch_shape)[0], mode

    def proximity(self, reference, measurement, state, mode):
        e = reference.value - measurement.q
        return Proximity(torch.cat([e] * self.width, dim=-1), e[..., 0])

    def reallocate(self, reference, measurement, state, mode, due):
        return Memory(torch.zeros_like(state.integral)), mode


def gains(self, reference, output, state):
    return InputGains(torch.ones(8, 1, 1, dtype=torch.float64), torch.zeros_like(output.input))


BROKEN: dict[str, tuple[Callable[[], control.Controller], str]] = {
    "a tensor that is no constant": (undeclared, "line 5: ratio is a tensor that is not regist"),
    "a buffer of float32": (of_float32, "line 5: ratio is torch.float32"),
    "derivatives it does not say": (
        lambda: changed(reference_order=0),
        "line 4: forward reads more than the 0 derivatives",
    ),
    "derivatives that are a word": (
        lambda: changed(reference_order="two"),
        "line 4: reference_order = 'two'",
    ),
    "no pair at the start": (
        lambda: starting(lambda batch, generator: Memory(zeros(*batch, 1))),
        "line 2: initial_state gives a Memory; return state and mode",
    ),
    "a state in a dict": (
        lambda: starting(lambda batch, generator: ({"integral": zeros(*batch, 1)}, None)),
        "line 2: initial_state gives no NamedTuple",
    ),
    "a state without its batch": (
        lambda: starting(lambda batch, generator: (Memory(zeros(1)), None)),
        r"line 2: initial_state for a batch of 8 has shapes \[\(1,\)\]",
    ),
    "a state of whole numbers": (
        lambda: starting(
            lambda batch, generator: (Memory(torch.zeros(*batch, 1, dtype=torch.int64)), None)
        ),
        "line 1: a field of the state is torch.int64",
    ),
    "a start by chance": (
        lambda: starting(lambda batch, generator: (Memory(torch.randn(*batch, 1).double()), None)),
        "line 2: initial_state gives other numbers each time without a generator",
    ),
    "weights of any kind": (
        lambda: changed(check_weights=lambda self, weights: torch.Size()),
        "line 2: check_weights takes an object",
    ),
    "a bare tensor": (
        lambda: changed(forward=lambda self, reference, *_: reference.value),
        "line 3: forward gives a Tensor; return a ControlOutput",
    ),
    "two inputs": (
        lambda: other_input(lambda self, e, de, i: torch.cat([e, de], dim=-1)),
        r"line 3: the input has shape \(8, 2\), not \(8, 1\)",
    ),
    "an input of float32": (
        lambda: other_input(lambda self, e, de, i: e.float()),
        "line 3: the input is torch.float32",
    ),
    "a rate of another kind": (
        lambda: other_answer(d_state=lambda right: Seen(right.signals.error)),
        "line 3: d_state is not like the state: it is a Seen, not a Memory",
    ),
    "a rate of another shape": (
        lambda: other_answer(d_state=lambda right: Memory(right.input[..., 0])),
        r"line 3: d_state is not like the state: integral has shape \(8,\)",
    ),
    "signals in a dict": (
        lambda: other_answer(signals=lambda right: {"error": right.input}),
        "line 3: signals are a dict",
    ),
    "a root of the negative": (
        lambda: other_input(lambda self, e, de, i: torch.sqrt(e - 10.0)),
        "line 3: the input is not finite",
    ),
    "random numbers": (
        lambda: other_input(lambda self, e, de, i: e + torch.randn_like(e)),
        "other numbers for the same arguments",
    ),
    "something kept": (lambda: other_input(counted), "other numbers for the same arguments"),
    "writing into the state": (lambda: other_input(written), "writes into its arguments"),
    "samples that mix": (
        lambda: other_input(lambda self, e, de, i: e - e.mean(0, keepdim=True)),
        "sample 0 of a batch has another forward",
    ),
    "a decision in Python": (lambda: other_input(decided), "vmap.*torch.where"),
    "a measurement detached": (
        lambda: other_input(lambda self, e, de, i: e.detach()),
        "gradient of forward by value of the reference is not what finite",
    ),
    "a state detached": (
        lambda: other_input(lambda self, e, de, i: e + i.detach()),
        "gradient of forward by integral of the state is not what finite",
    ),
    "a constant detached": (
        lambda: other_input(lambda self, e, de, i: self.gain.detach().unsqueeze(-1) * e),
        "line 5: the gradient of forward by the constant gain",
    ),
    "a constant that takes no batch": (
        lambda: other_input(lambda self, e, de, i: self.gain * e),
        r"line 5: forward with the constant gain of shape \(8,\)",
    ),
    "a root at rest": (
        lambda: other_input(lambda self, e, de, i: torch.sqrt(e.abs())),
        "line 3: a gradient is not finite where reference and measurement are 0",
    ),
    "a second jump that counts": (Counting, "line 6: a second jump at the same instant"),
    "a reset without a word": (Resetting, "line 6: jump changes the state, though"),
    "a mode that is none of slots": (
        lambda: changed(switches=True),
        "line 6: it `switches`, and its mode is a NoneType",
    ),
    "distances of other slots": (Switching, r"distances of proximity is torch.float64 \(8, 1\)"),
    "a reset that is not due": (
        lambda: changed(Switching, width=2),
        "reallocate changes samples in which no reset is due",
    ),
    "gains of other sizes": (
        lambda: changed(input_gains=gains),
        r"line 7: measurement of input_gains has shape \(8, 1, 1\), not \(8, 1, 2\)",
    ),
    "a loop that runs away": (
        lambda: other_input(lambda self, e, de, i: -1e13 * (e + i)),
        "line 3: a rollout of 5 steps diverges",
    ),
    "a loop that fails": (
        lambda: other_input(picky),
        "line 3: a rollout of 5 steps fails; RuntimeError: not of two",
    ),
}
