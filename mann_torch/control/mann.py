"""The memory augmented neural network (MANN) adaptive controller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from ..checks import instance, whole
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, per_matrix
from ..memory import WorkingMemory
from ..types import (
    ControllerState,
    ControlOutput,
    ControlSignals,
    InputGains,
    Measurement,
    MemoryMode,
    ReferenceSample,
    TrackingError,
)
from .adaptive_controller import AdaptiveController, Look
from .features import (
    AdaptiveNetwork,
    Approximation,
    Approximator,
    ErrorsAndReference,
    FeatureNetwork,
    NetworkInputs,
    Readouts,
)
from .laws import Drive
from .robust import RobustGain
from .tracking import FilteredTracking, check_joints, check_measured, tracking_gains

#: Defaults of the paper's network: C_w, C_v, kappa and the spread of its first weights.
_OF_NETWORK = (10.0, 10.0, 0.0, 0.1)


class MannController(AdaptiveController):
    """tau = gain r + W'(sigma + h_o) + b_w; without a memory, the plain network controller.

    Paper: eqs. (clawrobotarm), (nnoutput), with the network `AdaptiveNetwork` of `n_hidden` neurons
    on x~ = [e de s ds dds], I = 5n. `network` and `inputs` put any feature network and any input
    vector in their place, `readouts` slots of W beside it, judged by the torque that was applied:
    what feedback had to add is what a readout lacked. It drives n outputs whose values and rates
    are measured, by n inputs.

    Constants, by name: `error_gain` (Lambda), `base_gain` (K_v), `robust_gain` (k_v),
    `weight_bound` (Z_m), the network's `rate_W` (C_w), `rate_V` (C_v), `e_modification` (kappa),
    and the memory's `write_gain` (c_w), `shift_threshold` (theta), `key_rate` (c_k), if it has any.

    Raises `ConfigError` when the memory's N differs from the network's, when both `n_hidden` and a
    network are given or neither, `ShapeError` where network and inputs do not fit, `DomainError`
    for a constant outside its domain, `KindError` for an argument of a wrong type.
    """

    def __init__(
        self,
        n_joints: int,
        n_hidden: int | None = None,
        memory: WorkingMemory | None = None,
        error_gain: Numbers = 5.0,
        base_gain: Numbers = 20.0,
        robust_gain: Numbers = 10.0,
        weight_bound: Numbers = 0.0,
        rate_W: Numbers = _OF_NETWORK[0],
        rate_V: Numbers = _OF_NETWORK[1],
        e_modification: Numbers = _OF_NETWORK[2],
        initial_std: float = _OF_NETWORK[3],
        network: FeatureNetwork | None = None,
        inputs: NetworkInputs | None = None,
        readouts: Readouts | None = None,
    ) -> None:
        super().__init__()
        n_joints = whole("n_joints", n_joints)
        if (n_hidden is None) == (network is None):
            raise ConfigError("give n_hidden, for the paper's network, or a network: one of them")
        given = (rate_W, rate_V, e_modification, initial_std)
        if network is not None and any(a is not b for a, b in zip(given, _OF_NETWORK, strict=True)):
            raise ConfigError(
                "rate_W, rate_V, e_modification and initial_std: set them in the network given"
            )
        inputs = ErrorsAndReference(n_joints) if inputs is None else inputs
        width = instance("inputs", inputs, NetworkInputs).width
        if network is None:
            network = AdaptiveNetwork(
                width, whole("n_hidden", n_hidden), n_joints, rate_W, rate_V, e_modification,
                initial_std,
            )  # fmt: skip
        instance("network", network, FeatureNetwork)
        if (network.n_inputs, network.n_outputs) != (width, n_joints):
            raise ShapeError(
                f"a network of {network.n_inputs} inputs and {network.n_outputs} outputs among "
                f"{width} inputs and {n_joints} joints"
            )
        self.n_joints = n_joints
        self.tracking = FilteredTracking(n_joints, error_gain)
        self.inputs = inputs
        self.approximator = Approximator(network, memory, ("error_norm", "shortfall"), readouts)
        self.robust = RobustGain(base_gain, robust_gain, weight_bound)
        self.reference_order = max(1, inputs.reference_order)

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless there is an input for each of its outputs."""
        check_joints(self.n_joints, n_inputs, n_outputs)

    def form(self) -> int:
        """n."""
        return self.n_joints

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[ControllerState, MemoryMode | None]:
        """State and mode at t = 0; the memory starts from features there. Raises `KindError`."""
        check_measured(measurement)
        nn_input = self.look(reference, measurement, None).nn_input
        return self.approximator.initial_state(
            nn_input, measurement.q, batch_shape, generator, weights
        )

    def forward(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: MemoryMode | None,
    ) -> ControlOutput:
        """Torque (..., n) [N m], time derivative of the state, and signals."""
        tracking: TrackingError = self.tracking(reference, measurement)
        seen, r = self._seen(tracking, reference, measurement), tracking.filtered_error
        found: Approximation = self.approximator(seen.nn_input, r, seen.context, state, mode)
        gain = self.robust(found.norms)
        u = gain.unsqueeze(-1) * r + found.output
        drive = self.driven(reference, seen, found, state)
        rates = self.approximator.rates(found, drive, state, mode)
        signals = ControlSignals(tracking, found.features, found.read, found.weights, gain)
        return ControlOutput(u, rates, signals, self.forgets(state, found))

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: ControllerState
    ) -> InputGains:
        """Rate gain = gain I + W' diag(sigma') V_de'; position gain = rate gain Lambda.

        The input answers to e and de: as time goes on, the reference moves both.
        """
        n = self.n_joints
        rate = per_matrix(output.signals.gain) * torch.eye(n, dtype=output.input.dtype)
        first = self.inputs.rate_from
        if first is not None:
            slope = self.network.input_slope(
                output.signals.features, self.approximator.in_force(state), first, n
            )
            rate = rate if slope is None else rate + slope
        return tracking_gains(rate @ self.tracking.error_gain, rate, reference)

    def adapted(self, state: ControllerState) -> ControllerState:
        """All of it."""
        return state

    def with_adapted(self, state: ControllerState, adaptive: ControllerState) -> ControllerState:
        """The other one."""
        return adaptive

    def look(self, reference: ReferenceSample, measurement: Measurement, state: Any) -> Look:
        """x~, r, q and e."""
        return self._seen(self.tracking(reference, measurement), reference, measurement)

    def _seen(
        self, tracking: TrackingError, reference: ReferenceSample, measurement: Measurement
    ) -> Look:
        nn_input = self.inputs(tracking, reference, measurement)
        r = tracking.filtered_error
        return Look(nn_input, r, measurement.q, tracking.error, measurement)

    def driven(
        self, reference: ReferenceSample, seen: Look, found: Approximation, state: Any
    ) -> Drive:
        """r drives, and |e| is that of positions."""
        error_norm = torch.linalg.vector_norm(seen.error, dim=-1)
        shortfall = None
        if self.approximator.readouts is not None:
            shortfall = self.robust(found.norms).unsqueeze(-1) * seen.drive
        return Drive.of_features(found.features.hidden, seen.drive, error_norm, shortfall=shortfall)
