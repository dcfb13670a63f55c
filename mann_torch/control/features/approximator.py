"""A network and a working memory beside it: what a controller adapts with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...checks import instance, several
from ...constraints import DesignModule
from ...errors import ConfigError
from ...memory import WorkingMemory
from ...types import ControllerState, Features, MemoryMode, MemoryState, Proximity
from ..laws import Drive
from ..laws.needs import check_needs
from .feature_network import FeatureNetwork
from .readouts import Readouts


class Approximation(NamedTuple):
    """What network and memory give at one input."""

    output: Tensor  # (..., m) W'(sigma + h_o) + ...
    norms: Tensor  # (...,) of weights and memory
    network: Any  # weights in force
    nn_input: Tensor  # (..., I)
    features: Features
    correction: Tensor  # (..., N) W r
    read: Tensor | None  # (..., N) h_o
    weights: Tensor | None  # (..., S) w_r
    d_memory: MemoryState | None


class Approximator(DesignModule):
    """f^ = W'(sigma(x~) + h_o): any feature network, with a working memory or without.

    A controller holds one, feeds it x~, its error feedback r and the context of state keys, and
    keeps its state and mode among its own. `offers` are the fields of `Drive` that the controller
    gives beyond regressor and error. `readouts` are slots of W, whose weights stand for the
    memory's in telemetry where there is none. Raises `ConfigError` where a law or `readouts` need
    others, or where the memory's N differs from the network's; `KindError`.
    """

    def __init__(
        self,
        network: FeatureNetwork,
        memory: WorkingMemory | None = None,
        offers: Iterable[str] = ("error_norm",),
        readouts: Readouts | None = None,
    ) -> None:
        super().__init__()
        self.network = instance("network", network, FeatureNetwork)
        held = network.n_hidden
        if memory is not None and instance("memory", memory, WorkingMemory).n_hidden != held:
            raise ConfigError(
                f"the memory stores N = {memory.n_hidden} numbers a slot, the network has "
                f"N = {held} neurons: they must be equal"
            )
        self.memory = memory
        given = several("offers", offers, str)
        for law in network.laws:
            check_needs(law, given)
        self.readouts = readouts
        if readouts is not None:
            instance("readouts", readouts, Readouts).fit(network, given)

    @property
    def reallocates(self) -> bool:
        """Whether a jump can change its state."""
        return self._resets or (self.memory is not None and self.memory.attention.reallocates)

    @property
    def _resets(self) -> bool:
        return any(law.resets for law in self.network.laws)

    @property
    def periods(self) -> tuple[float, ...]:
        """Periods [s] at whose multiples its laws sample."""
        return tuple(period for law in self.network.laws for period in law.periods)

    @property
    def switches(self) -> bool:
        """Whether the memory attends one slot at a time."""
        return self.memory is not None and self.memory.attention.switches

    def initial_state(
        self,
        nn_input: Any,
        context: Tensor,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[ControllerState, Any]:
        """State and mode at t = 0; the memory starts from features at x~ (..., I) there."""
        if weights is None:
            weights = self.network.initial_state(batch_shape, generator)
        else:
            self.network.check_state(weights)
        network = self.network.expand(weights, batch_shape)
        laws, mode = self.network.initial_laws(batch_shape)
        held = None
        if self.readouts is not None:
            held = self.readouts.initial_state(self.network, network, batch_shape)
        if self.memory is None:
            return ControllerState(network, None, laws, held), mode
        hidden = self.network.first_features(nn_input, network)
        memory = self.memory.initial_state(hidden, context)
        slots = self.memory.initial_mode(hidden.shape[:-1])._replace(law=mode)
        return ControllerState(network, memory, laws, held), slots

    def in_force(self, state: ControllerState) -> Any:
        """The network's weights; with readouts, a blend of those."""
        if self.readouts is None or state.readouts is None:
            return state.network
        return self.readouts.blended(self.network, state.network, state.readouts)

    def forward(
        self, nn_input: Tensor, feedback: Tensor, context: Tensor, state: ControllerState, mode: Any
    ) -> Approximation:
        """f^ and what else comes of x~ (..., I), for error feedback r (..., m)."""
        network = self.in_force(state)
        features = self.network.features(nn_input, network)
        correction = self.network.correction(feedback, network)
        norms = self.network.magnitude(network)
        hidden, read, weights, d_memory = features.hidden, None, None, None
        if self.memory is not None and state.memory is not None and mode is not None:
            read, weights, d_memory = self.memory(hidden, correction, context, state.memory, mode)
            norms = norms + self.memory.magnitude(state.memory, mode)
            hidden = hidden + read
        output = self.network.output(hidden, network)
        if self.readouts is not None and state.readouts is not None and weights is None:
            weights = self.readouts.weights(state.readouts)
        return Approximation(
            output, norms, network, nn_input, features, correction, read, weights, d_memory
        )

    def decay(self, found: Approximation) -> ControllerState | None:
        """How fast what is remembered forgets [1/s], None without a memory.

        Contents by w_r(i), keys by their rule's own rate.
        """
        if self.memory is None or found.weights is None:
            return None
        rate = self.memory.key_rule.rate(found.weights)
        width = min(1, self.memory.initial_keys.shape[-1])  # of one for all numbers of a key
        memory = MemoryState(found.weights.unsqueeze(-1), rate.unsqueeze(-1)[..., :width])
        return ControllerState(None, memory)

    def rates(
        self, found: Approximation, drive: Drive, state: ControllerState, mode: Any
    ) -> ControllerState:
        """Time derivative of the state, driven by `drive`, whose regressor is sigma."""
        decided = mode.law if isinstance(mode, MemoryMode) else mode
        network, laws = self.network.derivative(
            found.nn_input, found.features, drive, found.correction, found.network, state.laws,
            decided,
        )  # fmt: skip
        held = None
        if self.readouts is not None and state.readouts is not None:
            hidden = found.features.hidden
            network, held = self.readouts.rates(
                self.network, state.network, network,
                hidden if found.read is None else hidden + found.read, found.output, drive,
                state.readouts,
            )  # fmt: skip
        return ControllerState(network, found.d_memory, laws, held)

    def jump(
        self,
        nn_input: Tensor,
        feedback: Tensor,
        context: Tensor,
        state: ControllerState,
        mode: Any,
        drive_of: Callable[[Approximation], Drive],
    ) -> tuple[ControllerState, Any]:
        """Decisions of the laws, then of the memory: reallocation, which slot is attended now.

        `drive_of` is asked only where a law decides.
        """
        slots = mode if isinstance(mode, MemoryMode) else None
        decided = mode if slots is None else slots.law
        if decided is None and not self._resets:
            if slots is None:
                return state, mode
            features = self.network.features(nn_input, state.network)
        else:
            found = self.forward(nn_input, feedback, context, state, mode)
            features = found.features
            laws, decided = self.network.jump(
                nn_input, features, drive_of(found), found.correction, found.network, state.laws,
                decided,
            )  # fmt: skip
            state = state._replace(laws=laws)
        if self.memory is None or state.memory is None or slots is None:
            return state, decided
        memory, slots = self.memory.jump(features.hidden, context, state.memory, slots)
        return state._replace(memory=memory), slots._replace(law=decided)

    def proximity(
        self, nn_input: Tensor, context: Tensor, state: ControllerState, mode: MemoryMode
    ) -> Proximity:
        """What decides the memory's next event."""
        if self.memory is None or state.memory is None:
            raise NotImplementedError("no memory, no events")
        hidden = self.network.features(nn_input, state.network).hidden
        return self.memory.proximity(hidden, context, state.memory, mode)

    def reallocate(
        self,
        nn_input: Tensor,
        context: Tensor,
        state: ControllerState,
        mode: MemoryMode,
        due: Tensor,
    ) -> tuple[ControllerState, MemoryMode]:
        """The memory's reset, in the samples `due` (...,) bool."""
        if self.memory is None or state.memory is None:
            return state, mode
        hidden = self.network.features(nn_input, state.network).hidden
        memory, mode = self.memory.reallocate(hidden, context, state.memory, mode, due)
        return state._replace(memory=memory), mode
