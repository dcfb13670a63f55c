"""Wing rock: the roll of a slender delta wing at a large angle of attack."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import flag
from ..domains import Finite
from ..functional import times_column
from ..stiff import FirstOrderBlock
from ..types import Channel, InputGains
from .first_order import RowState
from .mechanical import two_by_two
from .plant import Field, Input, Plant, zeros

#: Weights of Chowdhary and Johnson 2010, Concurrent learning for convergence in adaptive control.
CHOWDHARY_JOHNSON = (0.8, 0.2314, 0.6918, -0.6245, 0.0095, 0.0214)
#: Weights of Elzebda, Nayfeh and Mook 1989, whose open loop has a stable limit cycle.
ELZEBDA = (0.0, -0.01859521, 0.015162375, -0.06245153, 0.00954708, 0.02145291)


class WingRockParameters(NamedTuple):
    """Weights of the rolling moment."""

    weights: Tensor  # (..., 6) of 1, x1, x2, |x1| x2, |x2| x2, x1^3


class WingRockMeasurement(NamedTuple):
    """What is seen with an accelerometer."""

    x: Tensor  # (..., 2) roll angle [rad] and rate [rad/s]
    moment: Tensor  # (..., 1) [rad/s^2] W' phi: what accelerates the wing, less the input


_FIELDS = {"weights": Field(CHOWDHARY_JOHNSON, Finite(), "1/s^2")}


class WingRock(Plant):
    """Roll angle x1 [rad] and rate x2 [rad/s] of a wing: dx1/dt = x2, dx2/dt = u + W' phi(x).

    phi = (1, x1, x2, |x1| x2, |x2| x2, x1^3). The default weights are `CHOWDHARY_JOHNSON`; those of
    `ELZEBDA` have a limit cycle without input, of amplitude 0.6076 and period 56.137. Source:
    Chowdhary and Johnson 2010. The state is measured, with an `accelerometer` the moment W' phi as
    well; the angle is to follow the reference. Raises `KindError`.
    """

    Parameters = WingRockParameters
    fields = _FIELDS

    def __init__(self, accelerometer: bool = False) -> None:
        super().__init__()
        self.accelerometer = flag("accelerometer", accelerometer)

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Rolling moment over inertia."""
        return (Channel("u", "rad/s^2"),)

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The roll angle."""
        return (Channel("roll", "rad"),)

    @staticmethod
    def basis(x: Tensor) -> Tensor:
        """phi(x): (..., 2) -> (..., 6)."""
        x_1, x_2 = x.unbind(-1)
        parts = [torch.ones_like(x_1), x_1, x_2, x_1.abs() * x_2, x_2.abs() * x_2, x_1 * x_1 * x_1]
        return torch.stack(parts, dim=-1)

    def rest(self) -> RowState:
        """Level and still; no equilibrium where the first weight is not 0."""
        return RowState(*zeros(2))

    def output(self, state: RowState, coefficients: WingRockParameters) -> Tensor:
        """The roll angle (..., 1) [rad]."""
        return state.x[..., :1]

    def measure(self, state: RowState, coefficients: WingRockParameters) -> object:
        """The state, and the moment where there is an accelerometer."""
        if not self.accelerometer:
            return state
        moment = self._moment(state.x, coefficients).unsqueeze(-1)
        return WingRockMeasurement(state.x.expand(*moment.shape[:-1], 2), moment)

    def _moment(self, x: Tensor, coefficients: WingRockParameters) -> Tensor:
        """W' phi (...,)."""
        return (coefficients.weights * self.basis(x)).sum(-1)

    def derivative(
        self,
        t: Tensor,
        state: RowState,
        input: Input,
        disturbance: Tensor | None,
        coefficients: WingRockParameters,
    ) -> RowState:
        """(x2, u + W' phi) (..., 2)."""
        moment = self._moment(state.x, coefficients) + input.u[..., 0]
        rate = state.x[..., 1].expand(moment.shape)
        return RowState(torch.stack([rate, moment], dim=-1))

    def linearized(
        self,
        t: Tensor,
        state: RowState,
        input: Input,
        disturbance: Tensor | None,
        coefficients: WingRockParameters,
        gains: InputGains | None,
    ) -> tuple[RowState, FirstOrderBlock | None]:
        """The derivative, and the block of wing and controller; the wing alone is not stiff."""
        rate = self.derivative(t, state, input, disturbance, coefficients)
        if gains is None:
            return rate, None
        x_1, x_2 = state.x.unbind(-1)
        _, w_1, w_2, w_3, w_4, w_5 = coefficients.weights.unbind(-1)
        by_angle = w_1 + w_3 * torch.sign(x_1) * x_2 + 3.0 * w_5 * x_1 * x_1
        by_rate = w_2 + w_3 * x_1.abs() + 2.0 * w_4 * x_2.abs()
        zero = torch.zeros_like(by_angle)
        jacobian = two_by_two(zero, zero + 1.0, by_angle, by_rate)
        B = torch.stack([torch.zeros_like(zero), torch.ones_like(zero)], dim=-1).unsqueeze(-1)
        answer = gains.measurement
        if self.accelerometer:  # the moment answers to the state too
            by_state = torch.stack([by_angle, by_rate], dim=-1).unsqueeze(-2)
            answer = answer[..., :2] + answer[..., 2:] @ by_state
        jacobian = jacobian - B @ answer
        return rate, FirstOrderBlock(jacobian, times_column(B, gains.drift))
