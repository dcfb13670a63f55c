"""A controller as a step for its users: state in, state out, at a fixed rate."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..compiled import UntraceableError, with_tensors
from ..errors import ConfigError, KindError
from ..trees import map_tensors
from .blob import Blob
from .ports import Ports
from .programs import CompiledTick, values_of
from .tick import DIVERGED, REFUSED, Kept, Tick


class Stepped(NamedTuple):
    """What a step gives."""

    input: Tensor  # (m,) the command
    state: Tensor  # (size,) one flat tensor
    flags: int  # `REFUSED`, `SATURATED`, `DIVERGED`, together


class Stepper:
    """A controller at instants `period` [s] apart: state in, state out.

    Made by `mann_torch.deploy`: `u, state = stepper(state, reference, measurement)`. A step adapts
    over the period, decides, and commands (`Tick`); it has no plant and no solver. `reference` is a
    `ReferenceSample` or its row (R,), `measurement` what the plant measures or its row (Y,):
    `ports` names their numbers. The state is one flat tensor (size,) of the stepper's dtype, which
    a step leaves as it is; it can be saved, and goes on elsewhere (`to_bytes`).

    It runs on the compiled engine, unless the tick can't be compiled: then in eager torch, and
    `engine_reason` says why. Constants are those of when it was made: deploy again what was tuned.
    Not differentiable: rollouts are.
    """

    def __init__(self, tick: Tick, dtype: torch.dtype, engine: str) -> None:
        self.tick, self.dtype = tick, dtype
        #: Its constants by name, in float64 and in the precision of its steps.
        self.exact, self.values = (values_of(tick, d) for d in (torch.float64, dtype))
        like = self._start(*(torch.zeros(n, dtype=dtype) for n in _sizes(tick.ports)))
        told = f"{type(tick.controller).__name__} {tick.period!r}"
        self._blob = Blob(like, dtype, told)
        #: Numbers of a flat state.
        self.size = self._blob.size
        self._compiled: CompiledTick | None = None
        #: Why the step runs in eager torch, if it does.
        self.engine_reason: str | None = "it was asked for"
        if engine == "compiled":
            try:
                self._compiled, self.engine_reason = CompiledTick(tick, like, dtype), None
            except UntraceableError as error:
                self.engine_reason = str(error)
        if self._compiled is None and dtype != torch.float64:
            self._check_precision(like)

    @property
    def ports(self) -> Ports:
        """Numbers that go in and out, by name."""
        return self.tick.ports

    @property
    def blob(self) -> Blob:
        """The form of a flat state."""
        return self._blob

    @property
    def period(self) -> float:
        """Time between steps [s]."""
        return self.tick.period

    @property
    def engine(self) -> str:
        """What runs a step: compiled, or eager."""
        return "eager" if self._compiled is None else "compiled"

    def initial_state(
        self,
        reference: Any,
        measurement: Any,
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> Tensor:
        """The state (size,) before the first step, of what there is to follow and to see then.

        What is random comes from the generator, without one from what the controller stores;
        `weights` are initial adaptive weights instead. Raises `ShapeError`, `DtypeError`,
        `KindError`, `ConfigError`.
        """
        if weights is not None:
            self.tick.controller.check_weights(weights)
        rows = self._rows(reference, measurement)
        with torch.no_grad():
            return self._blob.packed(self._start(*rows, generator, weights))

    def __call__(
        self, state: Tensor, reference: Any, measurement: Any, adapt: bool = True
    ) -> tuple[Tensor, Tensor]:
        """The command (m,) and the next state (size,); `step` tells flags, too."""
        return self.step(state, reference, measurement, adapt)[:2]

    @torch.no_grad()
    def step(self, state: Tensor, reference: Any, measurement: Any, adapt: bool = True) -> Stepped:
        """The command (m,), the next state (size,) and flags.

        Without `adapt` what adapts stays as it is. With `REFUSED` (a number that came in is not
        finite) and `DIVERGED` (one that would come out is not) nothing was done: the state is that
        which was given, and the command the last one. Raises `ShapeError`, `DtypeError`,
        `KindError`.
        """
        state = self._blob.check(state)
        state = state.detach() if state.requires_grad else state
        if adapt is not True and adapt is not False:
            raise KindError(f"adapt = {adapt!r}: give True or False")
        rows = self._rows(reference, measurement)
        if self._compiled is not None:
            after = self._compiled(*rows, adapt, state)
        else:
            after = self._eager(*rows, adapt, state)
        flags = self._blob.flags(after)
        m = len(self.ports.input)
        if flags & (REFUSED | DIVERGED):
            after = state
        return Stepped(after[:m].clone(), after, flags)

    def packed(self, kept: Kept) -> Tensor:
        """A tree of what is kept as a flat state. Raises `KindError`."""
        return self._blob.packed(instance("kept", kept, Kept))

    def unpacked(self, state: Tensor) -> Kept:
        """A flat state as a tree. Raises `ShapeError`, `DtypeError`, `KindError`."""
        return self._blob.unpacked(self._blob.check(state))

    def to_bytes(self, state: Tensor) -> bytes:
        """The state as bytes, which the C code's `restore` takes, too. Raises as `unpacked`."""
        return self._blob.to_bytes(self._blob.check(state))

    def from_bytes(self, data: bytes) -> Tensor:
        """A state from bytes of `to_bytes`, or of the C code's `save`.

        Raises `RecordError` for those of another controller, and for damaged ones.
        """
        return self._blob.from_bytes(instance("data", data, bytes))

    def to_c(
        self,
        folder: str | os.PathLike[str],
        name: str = "controller",
        constants: str = "baked",
        libm: bool = True,
    ) -> Path:
        """Write the step as C99 into a folder: header, source, test, Makefile, README.

        It is the program that the compiled engine runs, without allocation or recursion, in the
        stepper's precision. `name` begins files and functions; `constants` are "baked" into the
        code, or a "struct" that is given at each call; without `libm` nothing is linked. An earlier
        export of the same controller is replaced as a whole.

        Raises `ExportError` for a step that C cannot say, and for a folder that holds something
        else, `ConfigError`, `KindError`.
        """
        from .c_code import to_c

        return to_c(self, folder, name, constants, libm)

    def _rows(self, reference: Any, measurement: Any) -> tuple[Tensor, Tensor]:
        ports, dtype = self.ports, self.dtype
        return ports.reference_row(reference, dtype), ports.measurement_row(measurement, dtype)

    @torch.no_grad()
    def _start(self, reference: Tensor, measurement: Tensor, *given: Any) -> Kept:
        # Once, so in float64 whatever follows.
        with with_tensors(self.tick, self.exact):
            kept = self.tick.start(reference.double(), measurement.double(), *given)
        return map_tensors(lambda x: x.to(self.dtype) if x.is_floating_point() else x, kept)

    def _eager(self, reference: Tensor, measurement: Tensor, adapt: bool, state: Tensor) -> Tensor:
        kept, learns = self._blob.unpacked(state), torch.tensor(float(adapt), dtype=self.dtype)
        with with_tensors(self.tick, self.values):
            made = self.tick(reference, measurement, learns, kept)
        return self._blob.packed(made.kept, made.flags)

    def _check_precision(self, like: Kept) -> None:
        """Raise `ConfigError` where eager torch would compute in float64 after all."""
        zeros = [torch.zeros(n, dtype=self.dtype) for n in _sizes(self.ports)]
        with torch.no_grad(), with_tensors(self.tick, self.values):
            made = self.tick(*zeros, torch.ones((), dtype=self.dtype), like)
        if made.input.dtype != self.dtype:
            raise ConfigError(
                f"{type(self.tick.controller).__name__} computes in {made.input.dtype} whatever "
                f"it is given ({self.engine_reason}): take float64"
            )


def _sizes(ports: Ports) -> tuple[int, int]:
    return len(ports.reference), len(ports.measurement)
