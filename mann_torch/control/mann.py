"""The memory augmented neural network (MANN) adaptive controller."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..checks import instance, whole
from ..errors import ConfigError
from ..functional import Numbers, frobenius, number_by_number, per_matrix, times_column
from ..memory import WorkingMemory
from ..types import (
    ControllerState,
    ControlOutput,
    ControlSignals,
    Features,
    Measurement,
    MemoryMode,
    NetworkState,
    Proximity,
    ReferenceSample,
    TorqueGains,
    TrackingError,
)
from .controller import Controller
from .network import AdaptiveNetwork
from .robust import RobustGain
from .tracking import FilteredTracking


class MannController(Controller):
    """tau = gain r + W'(sigma + h_o) + b_w; without a memory, the plain network controller.

    The network's input is x~ = [e de s ds dds], I = 5n. Paper: eqs. (clawrobotarm), (nnoutput).
    Constants, by name: `error_gain` (Lambda), `base_gain` (K_v), `robust_gain` (k_v),
    `weight_bound` (Z_m), `rate_W` (C_w), `rate_V` (C_v), `e_modification` (kappa), and the
    memory's `write_gain` (c_w), `shift_threshold` (theta), `key_rate` (c_k) where it has them.

    Raises `ConfigError` when the memory's N differs from `n_hidden`, `DomainError` for a constant
    outside its domain, `KindError` for an argument of a wrong type.
    """

    def __init__(
        self,
        n_joints: int,
        n_hidden: int,
        memory: WorkingMemory | None = None,
        error_gain: Numbers = 5.0,
        base_gain: Numbers = 20.0,
        robust_gain: Numbers = 10.0,
        weight_bound: Numbers = 0.0,
        rate_W: Numbers = 10.0,
        rate_V: Numbers = 10.0,
        e_modification: Numbers = 0.0,
        initial_std: float = 0.1,
    ) -> None:
        super().__init__()
        n_joints, n_hidden = whole("n_joints", n_joints), whole("n_hidden", n_hidden)
        if memory is not None and instance("memory", memory, WorkingMemory).n_hidden != n_hidden:
            raise ConfigError(
                f"the memory stores N = {memory.n_hidden} numbers a slot, the network has "
                f"N = {n_hidden} neurons: they must be equal"
            )
        self.n_joints = n_joints
        self.tracking = FilteredTracking(n_joints, error_gain)
        self.network = AdaptiveNetwork(
            5 * n_joints, n_hidden, n_joints, rate_W, rate_V, e_modification, initial_std
        )
        self.robust = RobustGain(base_gain, robust_gain, weight_bound)
        self.memory = memory

    @property
    def reallocates(self) -> bool:  # type: ignore[override]
        """Whether the memory's attention can reset a slot."""
        return self.memory is not None and self.memory.attention.reallocates

    @property
    def switches(self) -> bool:  # type: ignore[override]
        """Whether the memory attends one slot at a time."""
        return self.memory is not None and self.memory.attention.switches

    def initial_network(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> NetworkState:
        """Adaptive weights at t = 0: random with a generator, else the stored draw."""
        return self.network.initial_state(batch_shape, generator)

    def check_network(self, network: NetworkState) -> None:
        """Raise `ShapeError`, `DtypeError` or `ConfigError` for weights that do not fit."""
        self.network.check_state(network)

    def initial_state(
        self, reference: ReferenceSample, measurement: Measurement, network: NetworkState
    ) -> tuple[ControllerState, MemoryMode | None]:
        """State and mode at t = 0; the memory starts from the features there."""
        if self.memory is None:
            return ControllerState(network, None), None
        _, _, features = self._look(reference, measurement, network)
        hidden = torch.sigmoid(number_by_number(features.pre))  # the same bits in any batch
        memory = self.memory.initial_state(hidden, measurement.q)
        mode = self.memory.initial_mode(hidden.shape[:-1])
        return ControllerState(network, memory), mode

    def forward(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: MemoryMode | None,
    ) -> ControlOutput:
        """Torque (..., n) [N m], d state/dt and signals."""
        network = state.network
        tracking, nn_input, features = self._look(reference, measurement, network)
        r = tracking.filtered_error
        correction = times_column(network.W, r)
        norms = frobenius(network.W) + frobenius(network.V)
        hidden, read, weights, d_memory = features.hidden, None, None, None
        if self.memory is not None and state.memory is not None and mode is not None:
            read, weights, d_memory = self.memory(
                hidden, correction, measurement.q, state.memory, mode
            )
            norms = norms + self.memory.magnitude(state.memory, mode)
            hidden = hidden + read
        gain = self.robust(norms)
        torque = gain.unsqueeze(-1) * r + self.network.output(hidden, network)
        error_norm = torch.linalg.vector_norm(tracking.error, dim=-1)
        d_network = self.network.derivative(nn_input, features, r, correction, error_norm, network)
        signals = ControlSignals(tracking, features, read, weights, gain)
        return ControlOutput(torque, ControllerState(d_network, d_memory), signals)

    def jump(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: MemoryMode | None,
    ) -> tuple[ControllerState, MemoryMode | None]:
        """The memory's decisions: reallocation, and which slot is attended now."""
        if self.memory is None or state.memory is None or mode is None:
            return state, mode
        _, _, features = self._look(reference, measurement, state.network)
        memory, mode = self.memory.jump(features.hidden, measurement.q, state.memory, mode)
        return state._replace(memory=memory), mode

    def proximity(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: MemoryMode,
    ) -> Proximity:
        """What decides the memory's next event."""
        if self.memory is None or state.memory is None:
            return super().proximity(reference, measurement, state, mode)
        hidden = self._look(reference, measurement, state.network)[2].hidden
        return self.memory.proximity(hidden, measurement.q, state.memory, mode)

    def reallocate(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: MemoryMode,
        due: Tensor,
    ) -> tuple[ControllerState, MemoryMode]:
        """The memory's reset, in the samples `due` (...,) bool."""
        if self.memory is None or state.memory is None:
            return state, mode
        hidden = self._look(reference, measurement, state.network)[2].hidden
        memory, mode = self.memory.reallocate(hidden, measurement.q, state.memory, mode, due)
        return state._replace(memory=memory), mode

    def torque_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: ControllerState
    ) -> TorqueGains:
        """Rate gain = gain I + W' diag(sigma') V_de'; position gain = rate gain Lambda.

        The torque answers to e and de: as time goes on, the reference moves both.
        """
        n = self.n_joints
        eye = torch.eye(n, dtype=output.torque.dtype)
        slope = self.network.input_slope(output.signals.features, state.network, first=n, n=n)
        rate = per_matrix(output.signals.gain) * eye + slope
        position = rate @ self.tracking.error_gain
        drift = times_column(position, reference.qd) + times_column(rate, reference.qdd)
        return TorqueGains(position, rate, drift)

    def _look(
        self, reference: ReferenceSample, measurement: Measurement, network: NetworkState
    ) -> tuple[TrackingError, Tensor, Features]:
        tracking: TrackingError = self.tracking(reference, measurement)
        nn_input = torch.cat(
            [tracking.error, tracking.error_rate, reference.q, reference.qd, reference.qdd], dim=-1
        )
        return tracking, nn_input, self.network.features(nn_input, network)
