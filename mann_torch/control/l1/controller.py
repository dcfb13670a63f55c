"""L1 adaptive control of a plant whose whole state is measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...checks import POSITIVE, instance, number
from ...constraints import PositiveRow
from ...errors import ConfigError, ShapeError
from ...functional import Numbers, as_float64, times_column
from ...trees import portable
from ...types import ControlOutput, Mode, ReferenceSample
from ..controller import Controller
from ..laws import AdaptiveLaw, BoxProjection, ConstantGain, Law
from ..lyapunov import error_gain_of
from ..matrices import MatrixConstants
from .adaptation import L1Adaptation, PredictorGradient
from .design import stable_pair
from .piecewise_constant import PiecewiseConstant


@portable
class L1State(NamedTuple):
    """Predictor, filter and estimates."""

    predicted: Tensor  # (..., d) x^
    input: Tensor  # (..., m) u, what the filter gives
    adaptation: Any


class L1Signals(NamedTuple):
    """What the controller shows."""

    prediction_error: Tensor  # (..., d) x~ = x^ - x
    matched: Tensor  # (..., m) what it thinks acts beside the input


class L1Adaptive(MatrixConstants, Controller):
    """x^' = A_m x^ + B (u + eta^), u = -C(s) (eta^ - k_g r), C = w_c / (s + w_c), of an input each.

    For plants x' = A_m x + B (u + theta'x): eta^ = theta^'x, and the `law` is driven by x and
    -B'P x~ with x~ = x^ - x, A_m'P + P A_m = -Q (a number, a row or SPD); the law is a gain
    of 1e4 in a box of 10 if none is given. With a `period` [s] in its place the piecewise-constant
    law finds all that acts. Source: Hovakimyan and Cao, L1 Adaptive Control Theory, 2010.

    A_m (d, d) is stable, B (d, m) of full rank. Constants: `bandwidth` w_c (m,) [rad/s],
    `command_gain` k_g (m, p), its entries row by row (a number stands for so many times 1), those
    of the law. What is measured are the d numbers of x. The input is a state: an explicit solver
    takes steps well below 1 / sqrt(gain |x|^2 B'P B).

    Raises `ConfigError`, `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        A_m: Numbers,
        B: Numbers,
        law: Law | None = None,
        period: float | None = None,
        bandwidth: Numbers = 30.0,
        command_gain: Numbers = 1.0,
        Q: Numbers = 1.0,
    ) -> None:
        super().__init__()
        A, b = stable_pair(A_m, B)
        if law is not None and period is not None:
            raise ConfigError("give a law, or the period of the piecewise-constant one: not both")
        self.size, self.n_inputs = b.shape
        self.A_m: Tensor
        self.B: Tensor
        self.register_buffer("A_m", A)
        self.register_buffer("B", b)
        self.adaptation: L1Adaptation
        if period is None:
            law = AdaptiveLaw(ConstantGain(1e4), BoxProjection(10.0)) if law is None else law
            through = error_gain_of(A, b, Q)
            self.adaptation = PredictorGradient(b, through, instance("law", law, Law))
        else:
            self.adaptation = PiecewiseConstant(A, b, number("period", period, POSITIVE))
        gain = as_float64(command_gain, "command_gain")
        if gain.dim() == 0:
            gain = gain * torch.eye(self.n_inputs, dtype=gain.dtype)
        self.n_outputs = self.declare_matrix("command_gain", gain, rows=self.n_inputs)[1]
        self.bandwidth: Tensor
        self.declare("bandwidth", bandwidth, PositiveRow(), (self.n_inputs,))

    @property
    def reallocates(self) -> bool:  # type: ignore[override]
        """Whether its law's state can jump."""
        return self.adaptation.resets

    @property
    def periods(self) -> tuple[float, ...]:  # type: ignore[override]
        """Of its law."""
        return self.adaptation.periods

    def check_fit(self, n_inputs: int, n_outputs: int) -> None:
        """Raise `ShapeError` unless the matrices are of the plant's sizes."""
        if (n_inputs, n_outputs) != (self.n_inputs, self.n_outputs):
            raise ShapeError(
                f"a plant of {n_inputs} inputs and {n_outputs} outputs got an L1 controller of "
                f"{self.n_inputs} inputs and {self.n_outputs} references"
            )

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[L1State, Mode]:
        """The predictor starts at x. Raises `ShapeError` unless d numbers are measured."""
        x = torch.cat(list(measurement), dim=-1)
        if x.shape[-1] != self.size:
            raise ShapeError(f"a predictor of {self.size} numbers: {x.shape[-1]} are measured")
        adaptation, mode = self.adaptation.initial_state(batch_shape)
        u = torch.zeros(*batch_shape, self.n_inputs, dtype=torch.float64)
        return L1State(x.expand(*batch_shape, self.size), u, adaptation), mode

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: L1State, mode: Mode
    ) -> ControlOutput:
        """u (..., m), what the filter gives."""
        x, error = _look(measurement, state)
        push, matched = self.adaptation(x, state.adaptation, mode)
        wanted = times_column(self.matrix("command_gain"), reference.value)
        rates = L1State(
            times_column(self.A_m, state.predicted) + times_column(self.B, state.input) + push,
            self.bandwidth * (wanted - matched - state.input),
            self.adaptation.rates(x, error, state.adaptation, mode),
        )
        return ControlOutput(state.input, rates, L1Signals(error, matched))

    def jump(
        self, reference: ReferenceSample, measurement: Any, state: L1State, mode: Mode
    ) -> tuple[L1State, Mode]:
        """Decisions of the law, samples of the piecewise-constant one."""
        kept, mode = self.adaptation.jump(*_look(measurement, state), state.adaptation, mode)
        return state._replace(adaptation=kept), mode

    def held(self, before: L1State, after: L1State) -> L1State:
        """Estimates stay; predictor and filter go on."""
        return after._replace(adaptation=before.adaptation)


def _look(measurement: Any, state: L1State) -> tuple[Tensor, Tensor]:
    """x and x~ (..., d)."""
    x = torch.cat(list(measurement), dim=-1)
    return x, state.predicted - x
