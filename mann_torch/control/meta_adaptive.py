"""Tracking with features that were learned elsewhere, beside a nominal model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..constraints import SymmetricPositiveDefinite
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, times_column
from ..memory import WorkingMemory
from ..trees import portable
from ..types import (
    ControllerState,
    ControlOutput,
    Features,
    InputGains,
    Measurement,
    Mode,
    ReferenceSample,
    TrackingError,
)
from .adaptive_controller import AdaptiveController, Look
from .boundary_layer import BoundaryLayer
from .error_feedback import ErrorFeedback
from .features import Approximation, Approximator, FeatureNetwork, Measured, NetworkInputs
from .integral import IntegralAction
from .laws import Drive
from .mechanics import Mechanics, NominalMechanics
from .tracking import FilteredTracking, check_joints, check_measured, tracking_gains


@portable
class MetaAdaptiveState(NamedTuple):
    """What adapts, and the integral of r."""

    adaptive: ControllerState
    integral: Tensor | None = None  # (..., n)


class MetaAdaptiveSignals(NamedTuple):
    """What the controller shows."""

    tracking: TrackingError
    features: Features
    read: Tensor | None  # (..., N) h_o
    weights: Tensor | None  # (..., S) w_r
    force: Tensor  # (..., n) what goes through B^-1


class MetaAdaptive(AdaptiveController):
    """u = B^-1 (M v' + C v + N + K r + W'(y + h_o)), v = ds/dt + Lambda e, r = v - qd.

    M, C, N and B are `mechanics` of nominal `parameters`: without them the first three are 0, B is
    1. y are features of `network` on `inputs`, [q; qd] if not given, and its law is driven by y
    and P r. A `memory` adds h_o; `robust` and `integral` are terms of r. Source: Richards, Azizan,
    Slotine and Pavone, Adaptive-control-oriented meta-learning for nonlinear systems, RSS 2021,
    arXiv 2103.04490, where y are layers trained on recorded flights, and W is -A'.

    Constants: `error_gain` Lambda, `feedback` K and `drive_gain` P (each a number, n diagonal
    entries or an SPD matrix), those of network, memory, robust and integral.

    Raises `ConfigError` for mechanics without parameters, or a law that needs a drive of another
    kind; `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        network: FeatureNetwork,
        mechanics: Mechanics | None = None,
        parameters: Any = None,
        memory: WorkingMemory | None = None,
        inputs: NetworkInputs | None = None,
        error_gain: Numbers = 5.0,
        feedback: Numbers = 20.0,
        drive_gain: Numbers = 1.0,
        robust: BoundaryLayer | None = None,
        integral: IntegralAction | None = None,
    ) -> None:
        super().__init__()
        self.n_joints = n = instance("network", network, FeatureNetwork).n_outputs
        if (mechanics is None) != (parameters is None):
            raise ConfigError("give mechanics and parameters, or neither for no nominal model")
        self.nominal = None if mechanics is None else NominalMechanics(mechanics, parameters)
        if self.nominal is not None and self.nominal.n_joints != n:
            raise ShapeError(
                f"mechanics of {self.nominal.n_joints} coordinates and a network of {n} outputs"
            )
        inputs = Measured(2 * n) if inputs is None else inputs
        self.inputs = instance("inputs", inputs, NetworkInputs)
        if network.n_inputs != inputs.width:
            raise ShapeError(f"a network of {network.n_inputs} inputs is fed {inputs.width}")
        self.tracking = FilteredTracking(n, error_gain)
        self.pushing = ErrorFeedback(n, feedback, robust, integral)
        self.drive_gain: Tensor
        self.declare("drive_gain", drive_gain, SymmetricPositiveDefinite(), (n, n))
        self.approximator = Approximator(network, memory)
        self.reference_order = max(1 if self.nominal is None else 2, inputs.reference_order)

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless there is an input for each of n outputs."""
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
    ) -> tuple[MetaAdaptiveState, Mode]:
        """State and mode at t = 0. Raises `KindError`."""
        check_measured(measurement)
        tracking = self.tracking(reference, measurement)
        seen = self._seen(tracking, reference, measurement)
        adaptive, mode = self.approximator.initial_state(
            seen.nn_input, seen.context, batch_shape, generator, weights
        )
        return MetaAdaptiveState(adaptive, self.pushing.initial_state(batch_shape)), mode

    def forward(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: MetaAdaptiveState,
        mode: Mode,
    ) -> ControlOutput:
        """u (..., n), time derivative of the state, and signals."""
        q, qd = measurement.q, measurement.qd
        tracking: TrackingError = self.tracking(reference, measurement)
        seen, r = self._seen(tracking, reference, measurement), tracking.filtered_error
        found: Approximation = self.approximator(
            seen.nn_input, r, seen.context, state.adaptive, mode
        )
        u = force = self.pushing(r, state.integral) + found.output
        if self.nominal is not None:
            pull = times_column(self.tracking.error_gain, tracking.error_rate)
            force = force + self.nominal.force(q, qd, qd + r, reference.upto(2)[2] + pull)
            u = self.nominal.input_of(q, force.unsqueeze(-1))[..., 0]
        drive = self.driven(reference, seen, found, state)
        rates = self.approximator.rates(found, drive, state.adaptive, mode)
        signals = MetaAdaptiveSignals(tracking, found.features, found.read, found.weights, force)
        kept = None if state.integral is None else r
        forgets = self.forgets(state, found)
        return ControlOutput(u, MetaAdaptiveState(rates, kept), signals, forgets)

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: MetaAdaptiveState
    ) -> InputGains:
        """Of the feedback, B^-1 (K [Lambda, 1] + M [0, Lambda]); features are not solved for."""
        tracking = output.signals.tracking
        rate = self.pushing.slope(tracking.filtered_error)
        position = rate @ self.tracking.error_gain
        if self.nominal is not None:
            q = reference.value - tracking.error
            rate = rate + self.nominal.mass(q) @ self.tracking.error_gain
            position = self.nominal.input_of(q, position)
            rate = self.nominal.input_of(q, rate)
        return tracking_gains(position, rate, reference)

    def look(
        self, reference: ReferenceSample, measurement: Measurement, state: MetaAdaptiveState
    ) -> Look:
        """x~, r, [q; qd], which state keys compare, and e."""
        return self._seen(self.tracking(reference, measurement), reference, measurement)

    def _seen(
        self, tracking: TrackingError, reference: ReferenceSample, measurement: Measurement
    ) -> Look:
        nn_input = self.inputs(tracking, reference, measurement)
        r = tracking.filtered_error
        context = torch.cat([measurement.q, measurement.qd], dim=-1)
        return Look(nn_input, r, context, tracking.error, measurement)

    def driven(
        self,
        reference: ReferenceSample,
        seen: Look,
        found: Approximation,
        state: MetaAdaptiveState,
    ) -> Drive:
        """P r drives, and |e| is that of positions."""
        error = times_column(self.drive_gain, seen.drive)
        error_norm = torch.linalg.vector_norm(seen.error, dim=-1)
        return Drive.of_features(found.features.hidden, error, error_norm)
