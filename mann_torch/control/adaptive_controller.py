"""What controllers share that adapt with an `Approximator`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..memory import WorkingMemory
from ..types import ControllerState, Mode, Proximity, ReferenceSample
from .controller import Controller
from .features import Approximation, Approximator, FeatureNetwork
from .laws import Drive


class Look(NamedTuple):
    """What is seen at one instant, by a network and by what drives it."""

    nn_input: Tensor  # (..., I)
    drive: Tensor  # (..., m) s
    context: Tensor  # (..., D) of state keys
    error: Tensor  # (..., k) the tracking error, of any size
    measurement: Any


class AdaptiveController(Controller):
    """A controller with an `approximator`, whose state has a field `adaptive` for what that keeps.

    Its mode is the approximator's. One whose state is the approximator's alone says so by
    `adapted` and `with_adapted`.
    """

    approximator: Approximator

    def adapted(self, state: Any) -> ControllerState:
        """What the approximator keeps, of the controller's state."""
        kept: ControllerState = state.adaptive
        return kept

    def with_adapted(self, state: Any, adaptive: ControllerState) -> Any:
        """The state with another one of that."""
        return state._replace(adaptive=adaptive)

    def forgets(self, state: Any, found: Approximation) -> Any:
        """How fast the state forgets, in its form: `ControlOutput.decay`."""
        decay = self.approximator.decay(found)
        if decay is None:
            return None
        return self.with_adapted(type(state)(*[None] * len(state)), decay)

    def held(self, before: Any, after: Any) -> Any:
        """Weights, memory and laws stay."""
        return self.with_adapted(after, self.adapted(before))

    @abstractmethod
    def look(self, reference: ReferenceSample, measurement: Any, state: Any) -> Look:
        """What is seen."""

    @abstractmethod
    def driven(
        self, reference: ReferenceSample, seen: Look, found: Approximation, state: Any
    ) -> Drive:
        """What drives the estimates."""

    @property
    def network(self) -> FeatureNetwork:
        """What adapts."""
        return self.approximator.network

    @property
    def memory(self) -> WorkingMemory | None:
        """What is remembered."""
        return self.approximator.memory

    @property
    def reallocates(self) -> bool:  # type: ignore[override]
        """Whether a jump can change its state: of a memory's slot, or of a law."""
        return self.approximator.reallocates

    @property
    def periods(self) -> tuple[float, ...]:  # type: ignore[override]
        """Of its laws."""
        return self.approximator.periods

    @property
    def switches(self) -> bool:  # type: ignore[override]
        """Whether the memory attends one slot at a time."""
        return self.approximator.switches

    def initial_weights(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> Any:
        """Adaptive weights at t = 0, as the network gives them."""
        return self.network.initial_state(batch_shape, generator)

    def check_weights(self, weights: Any) -> torch.Size:
        """Batch shape of weights. Raises `ShapeError`, `DtypeError` or `ConfigError`."""
        return torch.Size() if weights is None else self.network.check_state(weights)

    def jump(
        self, reference: ReferenceSample, measurement: Any, state: Any, mode: Mode
    ) -> tuple[Any, Mode]:
        """Decisions of laws and memory."""
        seen = self.look(reference, measurement, state)
        adaptive, mode = self.approximator.jump(
            seen.nn_input, seen.drive, seen.context, self.adapted(state), mode,
            lambda found: self.driven(reference, seen, found, state),
        )  # fmt: skip
        return self.with_adapted(state, adaptive), mode

    def proximity(
        self, reference: ReferenceSample, measurement: Any, state: Any, mode: Any
    ) -> Proximity:
        """What decides the memory's next event."""
        seen = self.look(reference, measurement, state)
        return self.approximator.proximity(seen.nn_input, seen.context, self.adapted(state), mode)

    def reallocate(
        self, reference: ReferenceSample, measurement: Any, state: Any, mode: Any, due: Tensor
    ) -> tuple[Any, Any]:
        """The memory's reset, in the samples `due` (...,) bool."""
        seen = self.look(reference, measurement, state)
        adaptive, mode = self.approximator.reallocate(
            seen.nn_input, seen.context, self.adapted(state), mode, due
        )
        return self.with_adapted(state, adaptive), mode
