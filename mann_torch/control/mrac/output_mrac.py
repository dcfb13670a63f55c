"""Model-reference adaptive control of an output of relative degree one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...checks import instance
from ...errors import ShapeError
from ...functional import Numbers, as_float64
from ...memory import WorkingMemory
from ...trees import portable
from ...types import ControllerState, ControlOutput, Features, InputGains, Mode, ReferenceSample
from ..adaptive_controller import AdaptiveController, Look
from ..boundary_layer import BoundaryLayer
from ..features import Approximation, Approximator, FeatureNetwork, Identity, LinearNetwork
from ..laws import Drive
from .following import check_followed, followed
from .input_output_filters import FilterState, InputOutputFilters


@portable
class OutputMracState(NamedTuple):
    """What adapts, and the filters."""

    adaptive: ControllerState
    filters: FilterState


class OutputMracSignals(NamedTuple):
    """What output MRAC shows."""

    error: Tensor  # (..., 1) e
    features: Features
    read: Tensor | None  # (..., N) h_o
    weights: Tensor | None  # (..., S) w_r


class OutputMrac(AdaptiveController):
    """u = theta' omega, theta' = Gamma omega e, e = y_m - y, omega = [w1, w2, y, r].

    For plants of one input and one output, relative degree one, stable zeros and a positive gain at
    high frequency, of order k + 1, after a model whose transfer function is strictly positive real:
    then e vanishes for any such plant. w1 and w2 are `InputOutputFilters` of k rates; without them
    omega = [y, r], for a plant of first order. `network` is any of 2k + 2 inputs and one output,
    whose law moves it; if none is given, omega itself is what it weighs. `memory` and `robust`, of
    e, are there if given. Its constants are those of its parts. Narendra and Annaswamy 1989, Stable
    Adaptive Systems, ch. 5. Raises `ConfigError` where a law needs what is not given, `ShapeError`,
    `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        filter_rates: Numbers = (),
        network: FeatureNetwork | None = None,
        memory: WorkingMemory | None = None,
        robust: BoundaryLayer | None = None,
    ) -> None:
        super().__init__()
        self.filters = InputOutputFilters(filter_rates)
        width = 2 * self.filters.n_filters + 2
        if network is None:
            network = LinearNetwork(Identity(width), 1)
        instance("network", network, FeatureNetwork)
        if (network.n_inputs, network.n_outputs) != (width, 1):
            raise ShapeError(
                f"a network of {network.n_inputs} inputs and {network.n_outputs} outputs: "
                f"filter_rates of {self.filters.n_filters} numbers ask for {width} and 1"
            )
        self.robust = None if robust is None else instance("robust", robust, BoundaryLayer)
        self.approximator = Approximator(network, memory)

    @classmethod
    def fed(cls, n_outputs: int, n_measured: int, given: Mapping[str, Any]) -> int:
        """Output, command, and what filters of both input and output have."""
        rates = as_float64(given.get("filter_rates", ()), "filter_rates")
        return n_measured + n_outputs + 2 * rates.numel()

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless there is one input and one output."""
        if (n_inputs, n_outputs) != (1, 1):
            raise ShapeError(
                f"a plant of {n_inputs} inputs and {n_outputs} outputs got output MRAC, of one each"
            )

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[OutputMracState, Mode]:
        """State and mode at t = 0. Raises `ConfigError` without a reference model, `ShapeError`."""
        check_followed("OutputMrac", reference, 1)
        found = sum(part.shape[-1] for part in measurement)
        if found != 1:
            raise ShapeError(f"OutputMrac reads one number, the output: {found} are measured")
        filters = self.filters.initial_state(batch_shape)
        seen = self._seen(reference, measurement, filters)
        adaptive, mode = self.approximator.initial_state(
            seen.nn_input, seen.context, batch_shape, generator, weights
        )
        return OutputMracState(adaptive, filters), mode

    def look(self, reference: ReferenceSample, measurement: Any, state: OutputMracState) -> Look:
        """omega, e and y."""
        return self._seen(reference, measurement, state.filters)

    def _seen(self, reference: ReferenceSample, measurement: Any, filters: FilterState) -> Look:
        y = measurement[0]
        omega = self.filters.regressor(y, followed("OutputMrac", reference)[1], filters)
        error = reference.value - y
        return Look(omega, error, y, error, measurement)

    def driven(
        self, reference: ReferenceSample, seen: Look, found: Approximation, state: OutputMracState
    ) -> Drive:
        """e and |e|."""
        size = seen.error[..., 0].abs()
        return Drive.of_features(found.features.hidden, seen.drive, size)

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: OutputMracState, mode: Mode
    ) -> ControlOutput:
        """u (..., 1), time derivative of the state, and signals."""
        seen = self.look(reference, measurement, state)
        found: Approximation = self.approximator(
            seen.nn_input, seen.drive, seen.context, state.adaptive, mode
        )
        u = found.output if self.robust is None else found.output + self.robust(seen.drive)
        drive = self.driven(reference, seen, found, state)
        adaptive = self.approximator.rates(found, drive, state.adaptive, mode)
        filters = self.filters.rates(u, seen.context, state.filters)
        signals = OutputMracSignals(seen.error, found.features, found.read, found.weights)
        forgets = self.forgets(state, found)
        return ControlOutput(u, OutputMracState(adaptive, filters), signals, forgets)

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: OutputMracState
    ) -> InputGains:
        """-d u/d y; that estimates, filters and reference move is not counted."""
        shown, first = output.signals, 2 * self.filters.n_filters
        gains = torch.zeros_like(output.input).unsqueeze(-1)
        slope = self.network.input_slope(shown.features, state.adaptive.network, first, 1)
        gains = gains if slope is None else gains - slope
        if self.robust is not None:
            gains = gains + self.robust.slope(shown.error)
        return InputGains(gains, torch.zeros_like(output.input))
