"""What disturbs a loop, and all that acts on it from outside."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from ..checks import instance
from ..errors import ConfigError
from ..types import ReferenceSample
from .reference import Reference
from .rows import Rows


class Forces(NamedTuple):
    """Disturbances at one time, None where there are none."""

    input: Tensor | None  # (..., m) on what the plant is given
    output: Tensor | None  # (..., Y) on what is measured
    state: Tensor | None  # (..., M) on the time derivative of the plant's state
    plant: Tensor | None  # (..., k) the plant's own disturbances: a wind


class Disturbance(Rows):
    """Signals that disturb a loop: any `Reference` will do, of which the value counts.

    `input` (p = m) is added to the applied input, `output` (p = Y) to the measurement before the
    sensor, `state` (p = M) to the time derivative of the plant's state, and `plant` (p = k) is what
    the plant names as its `disturbances`. Raises `ConfigError` for none, `KindError`.
    """

    def __init__(
        self,
        input: Reference | None = None,
        output: Reference | None = None,
        state: Reference | None = None,
        plant: Reference | None = None,
    ) -> None:
        super().__init__()
        given = {"input": input, "output": output, "state": state, "plant": plant}
        if all(signal is None for signal in given.values()):
            raise ConfigError("a disturbance on nothing: give input, output, state or plant")
        for name, signal in given.items():
            if signal is not None:
                instance(name, signal, Reference)
            setattr(self, name, signal)

    def forward(self, t: Tensor) -> Forces:
        """At times t [s], each (*t.shape, ..., p)."""
        return self._at(t, "forward")

    def aligned(self, t: Tensor) -> Forces:
        """Each sample at a time of its own."""
        return self._at(t, "aligned")

    def widths(self) -> dict[str, int]:
        """Width of each signal that is there."""
        return {n: getattr(self, n).width for n in Forces._fields if getattr(self, n) is not None}

    def _at(self, t: Tensor, method: str) -> Forces:
        signals = [getattr(self, name) for name in Forces._fields]
        return Forces(*(None if s is None else getattr(s, method)(t).value for s in signals))


class Outside(NamedTuple):
    """What acts on a loop at one time."""

    reference: ReferenceSample
    forces: Forces | None


class Surroundings(Rows):
    """Reference and disturbance of a scenario: all that acts on a loop from outside."""

    def __init__(self, reference: Reference, disturbance: Disturbance | None = None) -> None:
        super().__init__()
        self.reference, self.disturbance = reference, disturbance

    def forward(self, t: Tensor) -> Outside:
        """At times t [s]."""
        forces = None if self.disturbance is None else self.disturbance(t)
        return Outside(self.reference(t), forces)

    def aligned(self, t: Tensor) -> Outside:
        """Each sample at a time of its own, t (...,) [s] of the batch shape."""
        forces = None if self.disturbance is None else self.disturbance.aligned(t)
        return Outside(self.reference.aligned(t), forces)
