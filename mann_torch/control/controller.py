"""The controller interface: input and adaptation from reference, measurement and state."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from ..constraints import DesignModule
from ..errors import ConfigError
from ..interface import Interface
from ..types import (
    ControllerTree,
    ControlOutput,
    InputGains,
    MemoryMode,
    Mode,
    Proximity,
    ReferenceSample,
)


class Controller(Interface, DesignModule):
    """Interface of every controller. Its contract (`mann_torch.testing.check_controller`):

    1. State and mode are trees of the controller's own: NamedTuples of tensors (..., *event), or
       None. Nobody else looks into them. The state flows, in float64; the mode is what only jumps
       change.
    2. `initial_state` gives both, of the batch shape it is told, and has no random number but from
       its generator; without one it gives the same every time. It takes what `initial_weights`
       gives; `check_weights` says their batch shape, and refuses what does not fit.
    3. `forward` gives the input (..., m), the time derivative of the state, a tree like it, and
       signals worth plotting, a NamedTuple or None. It is a function of its arguments and of the
       controller's constants alone, for any batch at once, decided by `where`, in float64.
       Gradients reach them all, and are finite. It runs in a loop.
    4. `reference_order` says how many derivatives of the reference it asks for (`upto`), and
       `check_fit` refuses plants that are not its own.
    5. Constants are declared with a domain: they can be set, batched, saved and tuned by name. One
       with a batch shape gives each sample its own. Other tensors are buffers.
    6. `jump` gives state and mode after the decisions of one instant; a second jump at the same
       instant changes nothing (relaxed decisions alone go on, by shares). The state jumps only if
       it `reallocates`; if it `switches`, its mode is a `MemoryMode`, and `proximity` and
       `reallocate` are there.
    7. What it does from time to time it times itself (`control.timing`), and says `periods`.
    8. `input_gains` are None, or (..., m, Y) and (..., m); they may be approximate.
    """

    #: Derivatives of the reference that it asks for.
    reference_order = 0
    #: Periods [s] at whose multiples a step is to end: its `jump` samples there.
    periods: tuple[float, ...] = ()
    #: Whether `jump` can change the continuous state (reallocation).
    reallocates = False
    #: Whether its mode is a `MemoryMode` of branches whose events `proximity` compares.
    switches = False

    @abstractmethod
    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[ControllerTree, Mode]:
        """State and mode at t = 0, for samples of reference and measurement there.

        What is random comes from the generator, without one from what the controller stores.
        `weights` are initial adaptive weights, as `initial_weights` gives them, instead.
        """

    @abstractmethod
    def forward(
        self, reference: ReferenceSample, measurement: Any, state: ControllerTree, mode: Mode
    ) -> ControlOutput:
        """Input (..., m), time derivative of the state, and signals."""

    def jump(
        self, reference: ReferenceSample, measurement: Any, state: ControllerTree, mode: Mode
    ) -> tuple[ControllerTree, Mode]:
        """Discrete decisions at one instant: the state after them, and the new mode."""
        return state, mode

    def held(self, before: ControllerTree, after: ControllerTree) -> ControllerTree:
        """The state `after`, but for what adapts, which is as it was `before`; here nothing adapts.

        A deployed controller whose adaptation is frozen moves so (`mann_torch.deploy`), and its
        mode stays.
        """
        return after

    def initial_weights(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> Any:
        """Adaptive weights at t = 0, a tree, None here: it has none that are drawn."""
        return None

    def check_weights(self, weights: Any) -> torch.Size:
        """Batch shape of initial weights. Raises `ConfigError` if they do not fit."""
        if weights is not None:
            raise ConfigError(f"{type(self).__name__} takes no initial weights")
        return torch.Size()

    @classmethod
    def fed(cls, n_outputs: int, n_measured: int, given: Mapping[str, Any]) -> int:
        """How many numbers the network of a controller that takes one is fed: what is measured.

        `given` are arguments of its constructor.
        """
        return n_measured

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` if it is no controller for a plant of that many inputs and outputs."""
        return None

    def form(self) -> int | None:
        """Joints of a controller of `Measurement`, which needs no plant to say what it measures.

        None here: it depends on the plant.
        """
        return None

    def proximity(
        self, reference: ReferenceSample, measurement: Any, state: ControllerTree, mode: MemoryMode
    ) -> Proximity:
        """What decides the next event; asked only of a controller that `switches`."""
        raise NotImplementedError(f"{type(self).__name__} does not switch")

    def reallocate(
        self,
        reference: ReferenceSample,
        measurement: Any,
        state: ControllerTree,
        mode: MemoryMode,
        due: Tensor,
    ) -> tuple[ControllerTree, MemoryMode]:
        """The reset that `jump` would make, in the samples `due` (...,) bool."""
        return state, mode

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: ControllerTree
    ) -> InputGains | None:
        """How the input answers to the measurement and to time: what is solved implicitly.

        They may be approximate: the solver's order does not depend on them, its stability does.
        None here, which makes it an explicit method.
        """
        return None
