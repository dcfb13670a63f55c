"""Model-reference adaptive control of a measured state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...checks import instance
from ...errors import ShapeError
from ...functional import Numbers, times_column
from ...memory import WorkingMemory
from ...trees import portable
from ...types import ControllerState, ControlOutput, Features, InputGains, Mode, ReferenceSample
from ..adaptive_controller import AdaptiveController, Look
from ..boundary_layer import BoundaryLayer
from ..features import Approximation, Approximator, FeatureNetwork, Readouts
from ..integral import IntegralAction
from ..labels import Labels
from ..laws import Drive
from ..lyapunov import error_gain_of
from ..matrices import MatrixConstants
from ..saturation import Saturation
from .following import check_followed, followed
from .known_feedback import KnownFeedback
from .measured_state import check_measured_state, state_of


@portable
class MracState(NamedTuple):
    """What adapts, and what its parts keep; None where there is none."""

    adaptive: ControllerState
    integral: Tensor | None  # (..., m) of s
    saturation: Any
    labels: Any


class MracSignals(NamedTuple):
    """What MRAC shows."""

    error: Tensor  # (..., n) e
    drive: Tensor  # (..., m) s
    wanted: Tensor  # (..., m) u
    features: Features
    read: Tensor | None  # (..., N) h_o
    weights: Tensor | None  # (..., S) w_r


class Mrac(MatrixConstants, AdaptiveController):
    """u = K_r r - K_x x + K_e e + W'(phi(z) + h_o) + robust(s) + K_i int s, z = [x; r], s = E e.

    x (..., n) is all that is measured, r (..., p) the command of the loop's reference model and x_m
    its state; e = x_m - x, and of a limited input x_m + e_d - x. W is moved by the network's law
    for phi and s. `error_gain` E is B'P with A'P + P A = -Q: `of_model` finds it. `network` is any
    with n + p inputs and m outputs, `memory` adds h_o; `robust`, `integral`, `saturation` and
    `labels`, which measures the uncertainty for laws that learn from a `Pair`, are there if given;
    with labels, `readouts` are slots of W that are judged by them.

    Constants: `error_gain` (m, n), `feedback` K_x (m, n), `feedforward` K_r (m, p),
    `error_feedback` K_e (m, n), each row by row, where they are given, and those of the parts.
    Narendra and Annaswamy 1989, Stable Adaptive Systems, ch. 3. Raises `ConfigError` where a law
    needs what is not given, `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        error_gain: Numbers,
        network: FeatureNetwork,
        memory: WorkingMemory | None = None,
        feedback: Numbers | None = None,
        feedforward: Numbers | None = None,
        error_feedback: Numbers | None = None,
        robust: BoundaryLayer | None = None,
        integral: IntegralAction | None = None,
        saturation: Saturation | None = None,
        labels: Labels | None = None,
        readouts: Readouts | None = None,
    ) -> None:
        super().__init__()
        m, n = self.n_inputs, self.n_states = self.declare_matrix("error_gain", error_gain)
        instance("network", network, FeatureNetwork)
        self.n_commands = p = network.n_inputs - n
        if network.n_outputs != m or p < 1:
            raise ShapeError(
                f"a network of {network.n_inputs} inputs and {network.n_outputs} outputs: "
                f"error_gain is ({m}, {n}), so give n + p > {n} inputs and {m} outputs"
            )
        self.known = KnownFeedback((m, n, p), feedback, feedforward, error_feedback)
        self.robust = None if robust is None else instance("robust", robust, BoundaryLayer)
        self.integral = None if integral is None else instance("integral", integral, IntegralAction)
        self.saturation = saturation
        if saturation is not None:
            instance("saturation", saturation, Saturation)
            if saturation.n_inputs != m or saturation.n_states not in (None, n):
                raise ShapeError(
                    f"saturation of {saturation.n_inputs} inputs and {saturation.n_states} states "
                    f"in a controller of {m} and {n}"
                )
        self.labels = None if labels is None else instance("labels", labels, Labels)
        offers = {"error_norm"}
        offers |= set() if saturation is None else {"excess"}
        offers |= set() if labels is None else {"pair"}
        self.approximator = Approximator(network, memory, sorted(offers), readouts)

    @classmethod
    def of_model(
        cls,
        A: Numbers,
        B: Numbers,
        network: FeatureNetwork,
        Q: Numbers = 1.0,
        error_feedback: Numbers | None = None,
        **parts: Any,
    ) -> Mrac:
        """E = B'P of the model's A (n, n), less B K_e if there is one, and the input's B (n, m).

        Q is a number, a row (n,) or a matrix (n, n), and A'P + P A = -Q. `parts` are the other
        arguments. Raises `DomainError` where A is not stable, too.
        """
        gain = error_gain_of(A, B, Q, error_feedback)
        return cls(gain, network, error_feedback=error_feedback, **parts)

    @classmethod
    def fed(cls, n_outputs: int, n_measured: int, given: Mapping[str, Any]) -> int:
        """State and command."""
        return n_measured + n_outputs

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless inputs and commands are of the plant's numbers."""
        if (n_inputs, n_outputs) != (self.n_inputs, self.n_commands):
            raise ShapeError(
                f"a plant of {n_inputs} inputs and {n_outputs} outputs got MRAC of "
                f"{self.n_inputs} inputs and {self.n_commands} commands"
            )

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[MracState, Mode]:
        """State and mode at t = 0. Raises `ConfigError` without a reference model, `ShapeError`."""
        check_measured_state(measurement, self._field, self.n_inputs, self.n_states)
        check_followed("Mrac", reference, self.n_commands, self.n_states)
        kept = None if self.saturation is None else self.saturation.initial_state(batch_shape)
        seen = self._seen(reference, measurement, kept)
        x = seen.context
        adaptive, mode = self.approximator.initial_state(
            seen.nn_input, x, batch_shape, generator, weights
        )
        integral = filters = None
        if self.integral is not None:
            integral = self.integral.initial_state(self.n_inputs, batch_shape)
        if self.labels is not None:
            filters = self.labels.initial_state(self.network.n_hidden, x, batch_shape)
        return MracState(adaptive, integral, kept, filters), mode

    @property
    def _field(self) -> str | None:
        return None if self.labels is None else self.labels.field

    def look(self, reference: ReferenceSample, measurement: Any, state: MracState) -> Look:
        """z, s, x and e."""
        return self._seen(reference, measurement, state.saturation)

    def _seen(self, reference: ReferenceSample, measurement: Any, kept: Any) -> Look:
        x = torch.cat(state_of(measurement, self._field), dim=-1)
        model, command = followed("Mrac", reference)
        error = model - x
        blamed = None if self.saturation is None else self.saturation.error(kept)
        error = error if blamed is None else error + blamed
        s = times_column(self.matrix("error_gain"), error)
        z = torch.cat([x, command.expand(*x.shape[:-1], command.shape[-1])], dim=-1)
        return Look(z, s, x, error, measurement)

    def driven(
        self, reference: ReferenceSample, seen: Look, found: Approximation, state: MracState
    ) -> Drive:
        """s, |e|, what the input lacks and what labels measure."""
        return self._driven(seen, found, state, self._wanted(reference, seen, found, state))

    def _driven(self, seen: Look, found: Approximation, state: MracState, wanted: Tensor) -> Drive:
        excess = pair = None
        if self.saturation is not None:
            excess = self.saturation.excess(wanted)
        hidden = found.features.hidden
        if self.labels is not None:
            pair = self.labels.pair(seen.measurement, seen.context, hidden, state.labels)
        size = torch.linalg.vector_norm(seen.error, dim=-1)
        return Drive.of_features(hidden, seen.drive, size, excess, pair)

    def _wanted(
        self, reference: ReferenceSample, seen: Look, found: Approximation, state: MracState
    ) -> Tensor:
        """u (..., m), as if nothing limited it."""
        command = followed("Mrac", reference)[1]
        u = self.known(found.output, command, seen.context, seen.error)
        if self.robust is not None:
            u = u + self.robust(seen.drive)
        if self.integral is not None and state.integral is not None:
            u = u + self.integral(state.integral)
        return u

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: MracState, mode: Mode
    ) -> ControlOutput:
        """u (..., m), time derivative of the state, and signals."""
        seen = self.look(reference, measurement, state)
        s = seen.drive
        found: Approximation = self.approximator(
            seen.nn_input, s, seen.context, state.adaptive, mode
        )
        wanted = u = applied = self._wanted(reference, seen, found, state)
        drive = self._driven(seen, found, state, wanted)
        adaptive = self.approximator.rates(found, drive, state.adaptive, mode)
        kept = filters = None
        if self.saturation is not None and drive.excess is not None:
            kept = self.saturation.rates(state.saturation, s, drive.excess)
            u, applied = self.saturation.command(wanted), wanted + drive.excess
        if self.labels is not None:
            filters = self.labels.rates(seen.context, applied, found.features.hidden, state.labels)
        integral = None if self.integral is None else s
        signals = MracSignals(seen.error, s, wanted, found.features, found.read, found.weights)
        forgets = self.forgets(state, found)
        return ControlOutput(u, MracState(adaptive, integral, kept, filters), signals, forgets)

    def input_gains(
        self, reference: ReferenceSample, output: ControlOutput, state: MracState
    ) -> InputGains:
        """-d u/d x of all terms; that estimates and reference move is not counted."""
        shown, n = output.signals, self.n_states
        gains = self.known.slope().expand(*shown.wanted.shape, n)
        weights = self.approximator.in_force(state.adaptive)
        slope = self.network.input_slope(shown.features, weights, 0, n)
        gains = gains if slope is None else gains - slope
        if self.robust is not None:
            gains = gains + self.robust.slope(shown.drive) @ self.matrix("error_gain")
        if self.saturation is not None:
            gains = gains * self.saturation.slope(shown.wanted).unsqueeze(-1)
        if self._field is not None:
            gains = torch.nn.functional.pad(gains, (0, self.n_inputs))
        return InputGains(gains, torch.zeros_like(shown.wanted))
